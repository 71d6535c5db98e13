"""DCP-RMP: a Riemannian motion policy on the dynamic closest point, as a goal-proposal module.

After the paper's appendix "DCP-RMP Details". With x_obs the dynamic scene point closest to the arm
and x_p the arm's surface point closest to it:

    x_r  = |x_p - x_obs|^2                     J_r = 2 (x_p - x_obs)^T J_p
    s    = 1 - 1 / (1 + exp(-xd_r / l_v))      1 when closing, 0 when opening
    f_r  = k_p exp(-x_r / l_p) - k_v s xd_r / (x_r / l_d + eps_d)
    M_r  = s g(x_r) mu_r / (x_r / l_m + eps_m)        g(x) = (x - r)^2 / r^2 for x <= r, else 0
    f_g  = k_g (q_g - q) - k_d qd                     M_g = mu_g I

pulled back to joint space and combined,

    qdd  = (J_r^T M_r J_r + M_g)^+ (J_r^T M_r f_r + M_g f_g)

and integrated by Euler steps from the arm's own state to the modified goal. Since J_r^T M_r J_r has
rank one, the inverse is closed (Sherman and Morrison).

Where this differs from what is published: x_r is the squared distance throughout, J_r its
derivative (the authors' released code takes a plain distance with the squared distance's Jacobian);
xd_r includes the obstacle's own motion, dx_obs/dt, because an obstacle that comes at a resting arm
is closing too; the constants are tuned for squared metres on problems drawn apart from the frozen
ones.
"""

from dataclasses import dataclass, field, replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray

from drpbench.compile import stored
from drpbench.contract import EPISODE, Observation, Scalar
from drpbench.geometry import matrix_to_quaternion
from drpbench.robot import PANDA, Robot, point_jacobian

from .dynamic_points import is_dynamic, near_arm, squared_distances, velocity
from .leaves import metric, push

_STILL = 5e-4  # [m] a point that moved less since the last frame is static
_APPEARED = 0.02  # [m] a point that would have moved more has just appeared


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Constants:
    """The appendix's constants, for x_r in m^2."""

    k_p: Scalar = 100.0
    l_p: Scalar = 0.02
    k_v: Scalar = 10.0
    l_v: Scalar = 0.01
    l_d: Scalar = 0.1
    eps_d: Scalar = 0.01
    mu_r: Scalar = 100_000.0
    l_m: Scalar = 0.02
    eps_m: Scalar = 0.001
    r: Scalar = 0.04
    """Dynamic points beyond this squared distance [m^2] do not matter."""
    k_g: Scalar = 1.0
    k_d: Scalar = 2.0
    mu_g: Scalar = 50.0
    euler_steps: int = field(default=10, metadata={"static": True})
    euler_period: Scalar = 0.1
    """[s] of one Euler step of the virtual goal."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Carry:
    """What DCP-RMP keeps of an observation until the next one."""

    inner: Any
    """the carry of the policy that it goes over"""
    points: Float[Array, "*batch N 3"]
    mask: Bool[Array, "*batch N"]
    """False everywhere before the first observation"""


_Array = Array | np.ndarray


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Reaction:
    """What DCP-RMP saw in an observation, and the goal it made of it. World frame."""

    active: Bool[_Array, "*batch"]
    """whether the goal was modified; without it the two points mean nothing"""
    obstacle_point: Float[_Array, "*batch 3"]
    """x_obs [m], the dynamic scene point closest to the arm"""
    arm_point: Float[_Array, "*batch 3"]
    """x_p [m], the arm's surface point closest to it"""
    goal_joints: Float[_Array, "*batch J"]
    """q_mg [rad]: q_g itself, exactly, where `active` is false"""


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class DcpRmp:
    """Any policy with its goal modified by DCP-RMP: `--policy straight+dcp-rmp`."""

    policy: Any
    constants: Constants = field(default_factory=Constants)
    robot: Robot = field(default=PANDA, metadata={"static": True})
    control_period: float = field(default=EPISODE.period, metadata={"static": True})
    """[s] between two observations."""

    @property
    def privileged(self) -> bool:
        return self.policy.privileged

    @property
    def about(self) -> str:
        """That of the policy below, for a result's header."""
        return getattr(self.policy, "about", "")

    def init(self, observation: Observation) -> Carry:
        return Carry(
            inner=self.policy.init(observation),
            points=observation.scene_points,
            mask=jnp.zeros_like(observation.scene_mask),
        )

    def act(
        self, observation: Observation, carry: Carry, key: PRNGKeyArray | None
    ) -> tuple[Any, Carry]:
        goal = self.reaction(observation, carry).goal_joints
        position, rotation = self.robot.grip_pose(self.robot.link_poses(goal))
        seen = replace(
            observation,
            goal_joints=jnp.asarray(goal),
            goal_position=position,
            goal_quaternion=matrix_to_quaternion(rotation),
        )
        target, inner = self.policy.act(seen, carry.inner, key)
        return target, Carry(inner, observation.scene_points, observation.scene_mask)

    def reaction(self, observation: Observation, carry: Carry) -> Reaction:
        """What `act` bases its answer on, for one observation and the carry that it would be
        given."""
        robot, model = self.robot, self.robot.moving_spheres
        q = observation.joint_position
        poses = robot.link_poses(q)
        centers, radii = model.world(poses), jnp.asarray(model.radius)
        coarse = np.arange(0, model.count, 4)
        near = near_arm(
            observation.scene_points, observation.scene_mask, centers[coarse], radii[coarse]
        )
        dynamic = is_dynamic(near, carry.points, carry.mask, threshold=_STILL)
        x_obs, x_p, sphere = _closest(near, dynamic, centers, radii)
        goal = integrate(
            self.constants,
            q,
            observation.joint_velocity,
            observation.goal_joints,
            x_p,
            point_jacobian(poses, x_p, jnp.asarray(model.frame)[sphere]),
            x_obs,
            velocity(x_obs, carry.points, carry.mask, self.control_period, farthest=_APPEARED),
        )
        matters = dynamic.any() & (jnp.sum(jnp.square(x_p - x_obs)) < self.constants.r)
        goal = jnp.where(
            matters, jnp.clip(goal, robot.joint_lower, robot.joint_upper), observation.goal_joints
        )
        return Reaction(
            active=(goal != observation.goal_joints).any(),
            obstacle_point=x_obs,
            arm_point=x_p,
            goal_joints=goal,
        )


def _closest(
    near: Float[Array, "P 3"],
    dynamic: Bool[Array, " P"],
    centers: Float[Array, "S 3"],
    radii: Float[Array, " S"],
) -> tuple[Float[Array, "3"], Float[Array, "3"], Int[Array, ""]]:
    """x_obs, the dynamic point closest to the arm; x_p, the arm's surface point closest to it; and
    that point's sphere."""
    # Each minimum is taken apart from its argument: XLA's argmin on the CPU is twenty times slower.
    gap = stored(jnp.min(jnp.sqrt(squared_distances(near, centers)) - radii, axis=1))
    x_obs = near[jnp.argmin(jnp.where(dynamic, gap, jnp.inf))]
    gap = stored(jnp.linalg.norm(x_obs - centers, axis=-1) - radii)
    sphere = jnp.argmin(gap)
    outward = x_obs - centers[sphere]
    length = jnp.maximum(jnp.linalg.norm(outward), 1e-6)
    # Inside the sphere the two points coincide; a millimetre keeps the direction defined.
    reach = jnp.minimum(radii[sphere], length - 1e-3)
    return x_obs, centers[sphere] + outward / length * reach, sphere


def integrate(
    c: Constants,
    q: Float[Array, " J"],
    qd: Float[Array, " J"],
    q_goal: Float[Array, " J"],
    x_p: Float[Array, "3"],
    jacobian: Float[Array, "3 J"],
    x_obs: Float[Array, "3"],
    v_obs: Float[Array, "3"],
) -> Float[Array, " J"]:
    """The modified goal [rad] after the Euler steps. x_p follows the virtual arm to first order,
    and x_obs keeps its velocity [m/s]."""

    def step(state: tuple, _: None) -> tuple[tuple, None]:
        p, v, obstacle = state
        offset = x_p + jacobian @ (p - q) - obstacle
        x_r = jnp.sum(offset * offset)
        j_r = 2.0 * offset @ jacobian
        xd_r = j_r @ v - 2.0 * offset @ v_obs
        closing = 1.0 - 1.0 / (1.0 + jnp.exp(jnp.clip(-xd_r / c.l_v, -50.0, 50.0)))
        f_r = push(c, x_r, xd_r, closing)
        gate = jnp.where(x_r <= c.r, (x_r - c.r) ** 2 / c.r**2, 0.0)
        m_r = metric(c, x_r, closing, gate)
        f_g = c.k_g * (q_goal - p) - c.k_d * v
        # J_r^T M_r J_r (J_r^T M_r J_r)^+ J_r^T M_r f_r = J_r^T M_r f_r, for one row J_r.
        force = j_r * (m_r * f_r) + c.mu_g * f_g
        along = m_r * (j_r @ force) / (c.mu_g + m_r * (j_r @ j_r))
        qdd = (force - j_r * along) / c.mu_g
        v = v + c.euler_period * qdd
        p = p + c.euler_period * v
        return (p, v, obstacle + c.euler_period * v_obs), None

    (goal, _, _), _ = jax.lax.scan(step, (q, qd, x_obs), None, length=c.euler_steps)
    return goal
