"""Compliant contact: where spheres of the arm are inside an obstacle, a spring-damper pushes them
out.

On each link the deepest sphere touches, with the force

    f = max(k d - c v, 0) n        d depth [m], v velocity along the normal n [m/s]

and J^T f is what it does at the joints. One contact a link, because explicit damping on every
sphere of a flat contact adds up to more than the time step bears.
"""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from drpbench.geometry import FAR, Primitives, nearest, normal, signed_distance
from drpbench.robot import PANDA, LinkPoses, Robot

STIFFNESS = 20_000.0  # k [N/m]
DAMPING = 200.0  # c [N s/m]
_DEEPEST = 0.03  # [m]; an obstacle that appears inside the arm must not shoot it away


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Contact:
    """How the arm (all links but the base) stands to the obstacles at one instant."""

    clearance: Float[Array, "*batch"]
    """Smallest signed distance [m] of any sphere to any obstacle."""
    sphere: Int[Array, "*batch"]
    """The sphere it belongs to, as an index into `robot.moving_spheres`."""
    torque: Float[Array, "*batch J"]
    """What contact does at the joints [N m]."""


def contact(
    poses: LinkPoses,
    joint_velocity: Float[Array, " J"],
    centers: Float[Array, "S 3"],
    obstacles: Primitives,
    robot: Robot = PANDA,
) -> Contact:
    """Clearance and contact torque, with `centers` the world positions [m] of
    `robot.moving_spheres`.

    Without obstacles the clearance is `FAR`.
    """
    if obstacles.count == 0:
        return Contact(jnp.float32(FAR), jnp.int32(0), jnp.zeros_like(joint_velocity))
    model = robot.moving_spheres
    distance = signed_distance(centers, obstacles) - model.radius

    # The deepest sphere of each moving frame (the joints' links, then the hand).
    deepest = model.closest(distance)
    depth = jnp.clip(-distance[deepest], 0.0, _DEEPEST)
    point = centers[deepest]
    direction = normal(point, obstacles, nearest(point, obstacles)[1])

    # A point on frame i moves with v = sum over joints j <= i of qd_j z_j x (p - o_j). That is
    # `point_jacobian` times qd, summed up once along the arm instead of for each frame: faster, and
    # the rounding that the shipped results were made with.
    axes, origins = poses.axes, poses.origins
    spin = jnp.cumsum(joint_velocity[:, None] * axes, axis=0)
    drift = jnp.cumsum(joint_velocity[:, None] * jnp.cross(origins, axes), axis=0)
    joint = np.minimum(model.frames, robot.joints) - 1
    velocity = jnp.cross(spin[joint], point) + drift[joint]
    along = jnp.sum(velocity * direction, axis=-1)
    magnitude = jnp.where(depth > 0.0, jnp.maximum(STIFFNESS * depth - DAMPING * along, 0.0), 0.0)
    force = magnitude[:, None] * direction

    # tau_j = sum over frames i >= j of z_j . ((p - o_j) x f).
    moment = jnp.cross(point, force)
    reaches = jnp.asarray(joint[None, :] >= np.arange(robot.joints)[:, None], force.dtype)
    total_force = jnp.sum(reaches[:, :, None] * force, axis=1)
    total_moment = jnp.sum(reaches[:, :, None] * moment, axis=1)
    torque = jnp.sum(axes * (total_moment - jnp.cross(origins, total_force)), axis=-1)

    first = jnp.argmin(distance[deepest])
    return Contact(distance[deepest][first], deepest[first], torque)
