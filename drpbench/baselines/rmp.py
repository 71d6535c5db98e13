"""RMP: Riemannian motion policies from the point cloud alone (Ratliff et al. 2018; Cheng et al.
2018).

Leaves, each an acceleration with a metric, on the arm as it is now:

    goal         qdd = k_g soft(q_g - q) - k_d qd                       M = mu_g I
    obstacle     x = distance from the closest sphere of a link to the scene point closest to it,
                 J = n^T J_p, n from that point to the sphere,
                 xdd = k_p exp(-x / l_p) - k_v s xd / (x / l_d + eps_d), s = 1 / (1 + exp(xd / l_v))
                 m = s g(x) mu_r / (x / l_m + eps_m),  g(x) = (1 - x / r)^2 within r
    joint limit  the same form in each joint's distance to either limit

combined as qdd = (sum J^T M J)^-1 (sum J^T M xdd), and integrated once to the servo's target.
The obstacle leaf is that of `drpbench.policies.leaves`, which DCP-RMP has in squared distance.
"""

from dataclasses import dataclass, field

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PRNGKeyArray

from drpbench.compile import stored
from drpbench.contract import Observation, Scalar
from drpbench.policies import leaves, squared_distances
from drpbench.robot import PANDA, Robot

_UNSEEN = 1.0e3  # [m]


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Rmp:
    """The baseline `rmp`. Gains in SI units, tuned on problems drawn apart from the frozen ones."""

    k_g: Scalar = 20.0
    k_d: Scalar = 8.0
    soft: Scalar = 0.5
    """[rad] from which the pull to the goal no longer grows."""
    mu_g: Scalar = 1.0
    k_p: Scalar = 30.0
    l_p: Scalar = 0.03
    k_v: Scalar = 10.0
    l_v: Scalar = 0.02
    l_d: Scalar = 0.1
    eps_d: Scalar = 0.05
    mu_r: Scalar = 40.0
    l_m: Scalar = 0.02
    eps_m: Scalar = 0.05
    r: Scalar = 0.1
    point_radius: Scalar = 0.01
    """[m] about each scene point that counts as occupied: the cloud is sparse."""
    mu_l: Scalar = 1.0
    period: Scalar = 1.0 / 18.0
    """[s] of the Euler step from acceleration to the velocity commanded."""
    robot: Robot = field(default=PANDA, metadata={"static": True})

    privileged = False

    def init(self, observation: Observation) -> tuple[()]:
        return ()

    def act(
        self, observation: Observation, carry: tuple[()], key: PRNGKeyArray | None
    ) -> tuple[Float[Array, " J"], tuple[()]]:
        robot = self.robot
        q, qd = observation.joint_position, observation.joint_velocity
        distance, jacobian = self._nearest(observation)
        rate = jacobian @ qd
        closing = jax.nn.sigmoid(-rate / self.l_v)
        push = leaves.push(self, distance, rate, closing)
        gate = jnp.square(jnp.maximum(1.0 - distance / self.r, 0.0))
        weight = leaves.metric(self, distance, closing, gate)

        away = observation.goal_joints - q
        length = jnp.linalg.norm(away)
        pull = self.k_g * away * self.soft / (self.soft + length) - self.k_d * qd

        metric = self.mu_g * jnp.eye(robot.joints) + (jacobian.T * weight) @ jacobian
        force = self.mu_g * pull + jacobian.T @ (weight * push)
        for room, sign in ((q - robot.joint_lower, 1.0), (robot.joint_upper - q, -1.0)):
            limit = self.mu_l * jnp.square(jnp.maximum(1.0 - room / 0.1, 0.0)) / (room + 0.01)
            metric = metric + jnp.diag(limit)
            force = force + sign * limit * self.k_p * jnp.exp(-room / 0.05) - limit * qd
        acceleration = jnp.linalg.solve(metric, force)

        most = jnp.asarray(robot.velocity_limit, q.dtype)
        velocity = jnp.clip(qd + self.period * acceleration, -most, most)
        return q + robot.servo_lag * velocity, carry

    def _nearest(self, observation: Observation) -> tuple[Float[Array, " F"], Float[Array, "F J"]]:
        """For each moving frame, the distance [m] from its closest sphere to its closest scene
        point, and that distance's Jacobian [m/rad]."""
        model = self.robot.moving_spheres
        poses = self.robot.link_poses(observation.joint_position)
        centers = model.world(poses)
        scene = jnp.where(observation.scene_mask[:, None], observation.scene_points, _UNSEEN)
        gap = jnp.sqrt(jnp.min(squared_distances(centers, scene), axis=1))
        clearance = stored(gap - model.radius)

        closest = model.closest(clearance)
        point = centers[closest]
        outward = point - scene[jnp.argmin(stored(squared_distances(point, scene)), axis=1)]
        normal = outward / jnp.maximum(jnp.linalg.norm(outward, axis=-1, keepdims=True), 1e-6)

        # n^T `point_jacobian`, with the joints beyond the frame left out last: the rounding that
        # the shipped results were made with.
        columns = jnp.cross(poses.axes[None], point[:, None] - poses.origins[None])
        joints = self.robot.joints
        moves = np.arange(1, joints + 1)[None] <= np.minimum(model.frames, joints)[:, None]
        jacobian = jnp.where(moves, jnp.sum(columns * normal[:, None], axis=-1), 0.0)
        return jnp.maximum(clearance[closest] - self.point_radius, 0.0), jacobian
