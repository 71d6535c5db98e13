"""What training minimises: the paper's loss over a chunk of S rows, in the units of
`drpbench.policies.networks.chunks`, and a term against contact.

L = 1/S sum_k |chunk_k - answer_k|
    + WEIGHT / R sum_k sum_s max(0, min(MARGIN, d*_ks) - d_ks) / MARGIN

d_ks is the clearance of the arm's sphere s where the answer puts it in row k, d*_ks where the
demonstration does: what was demonstrated costs nothing, however near it passes. R rows are looked
at: the one that is commanded and the last. (MPiNets and MPiFormer have such a term; the paper has
none.)
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from drpbench.geometry import Primitives
from drpbench.policies.networks.chunks import CHUNK, decode, lookahead
from drpbench.robot import PANDA, Robot

MARGIN = 0.02  # [m]
WEIGHT = 0.1


def chunk_loss(
    chunk: Float[Array, "*batch C J"], answer: Float[Array, "*batch C J"]
) -> Float[Array, ""]:
    """The mean of the first sum over a batch of chunks that were demonstrated, and of those that
    were answered."""
    squares = jnp.sum(jnp.square(chunk - answer), axis=-1)
    # The root's slope at zero is infinite.
    return jnp.mean(jnp.sqrt(squares + 1e-6))


def contact_loss(
    chunk: Float[Array, "B C J"],
    answer: Float[Array, "B C J"],
    joints: Float[Array, "B J"],
    goal: Float[Array, "B J"],
    obstacles: Primitives,
    robot: Robot = PANDA,
) -> Float[Array, ""]:
    """The mean of the second sum, with its weight, over a batch."""
    rows = jnp.array([lookahead(robot) - 1, CHUNK - 1])
    model = robot.moving_spheres

    def one(chunk: Array, answer: Array, q: Array, goal: Array, obstacles: Primitives) -> Array:
        def clearance(chunk: Array) -> Array:
            waypoints = decode(chunk, q, goal, robot)[rows]
            points = jax.vmap(lambda q: model.world(robot.link_poses(q)))(waypoints)
            fixed = jax.lax.stop_gradient(points)
            distance, normal = obstacles.distance_and_normal(fixed)
            # The distance's derivative by the point is the normal: dearer by way of the minimum.
            distance = distance + jnp.sum(normal * (points - fixed), axis=-1)
            return distance - jnp.asarray(model.radius)

        allowed = jnp.minimum(MARGIN, clearance(chunk))
        nearer = jnp.maximum(allowed - clearance(answer), 0.0)
        return jnp.mean(jnp.sum(nearer, axis=-1)) / MARGIN

    return WEIGHT * jnp.mean(jax.vmap(one)(chunk, answer, joints, goal, obstacles))
