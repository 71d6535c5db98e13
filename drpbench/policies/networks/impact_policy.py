"""IMPACT as a policy: one inference a control step, of which one waypoint is commanded."""

import functools
from dataclasses import dataclass, field

import jax
import jax.numpy as jnp

from .chunks import commanded
from .impact import ImpactSize, Parameters, apply


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Impact:
    """The network's chunk at each control step; the servos get its waypoint LOOKAHEAD (`chunks.py`)."""

    parameters: Parameters
    size: ImpactSize = field(metadata={"static": True})
    weights: str = field(default="", metadata={"static": True})
    """Which numbers these are, for a result's header: the SHA-256 of the file they came from, if any."""

    privileged = False

    def init(self, observation):
        return ()

    def act(self, observation, carry, key):
        q, goal = observation.joint_position, observation.goal_joints
        clouds = (observation.scene_points, observation.scene_mask, observation.robot_points)
        chunk = _batching(self.size)(self.parameters, *clouds, q, goal)
        return commanded(chunk, q, goal), carry


@functools.cache
def _batching(size: ImpactSize):
    """`apply`, given a whole batch at once where it is vmapped: it then knows the batch's size, and takes
    it in pieces that fit the cache."""

    @jax.custom_batching.custom_vmap
    def network(parameters, *seen):
        return apply(size, parameters, *seen)

    @network.def_vmap
    def _(count, batched, parameters, *seen):
        of_parameters, *of_seen = batched
        if any(jax.tree.leaves(of_parameters)):
            axes = jax.tree.map(lambda is_batched: 0 if is_batched else None, batched)
            return jax.vmap(functools.partial(apply, size), axes)(parameters, *seen), True
        seen = [
            x if is_batched else jnp.broadcast_to(x, (count, *x.shape))
            for x, is_batched in zip(seen, of_seen, strict=True)
        ]
        return apply(size, parameters, *seen), True

    return network
