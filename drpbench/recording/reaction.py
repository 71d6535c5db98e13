"""What DCP-RMP made of an episode: the dynamic closest point and the modified goal, seen again."""

from collections.abc import Mapping
from dataclasses import fields, replace
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from drpbench.compile import jit
from drpbench.contract import Movers
from drpbench.envs import State, World
from drpbench.geometry import signed_distance
from drpbench.policies import DcpRmp, Reaction
from drpbench.policies.dcp_rmp import Carry, Constants
from drpbench.robot import Robot

from .episode import Recording


def dcp_rmp_of(parameters: Mapping[str, object]) -> DcpRmp | None:
    """The DCP-RMP that goes over a policy, by the parameters in a result's header. None without
    one.

    What it goes over is left out: the modified goal does not depend on it.
    """
    names = [field.name for field in fields(Constants)]
    if not all(f"constants.{name}" in parameters for name in names):
        return None
    values: dict[str, Any] = {name: parameters[f"constants.{name}"] for name in names}
    constants = Constants(**values)
    return DcpRmp(policy=None, constants=constants)


def reaction(module: DcpRmp, episode: Recording, instants: np.ndarray) -> Reaction:
    """Asks the module again at the instants (N,) given, each with the cloud of the instant before.

    Only where a moving box is within the module's reach: elsewhere the goal stays what it is, and
    the two points are zero.
    """
    count = len(instants)
    found = Reaction(
        active=np.zeros(count, bool),
        obstacle_point=np.zeros((count, 3), np.float32),
        arm_point=np.zeros((count, 3), np.float32),
        goal_joints=np.tile(np.asarray(episode.problem.goal, np.float32), (count, 1)),
    )
    if not episode.boxes.count:
        return found
    gap = _gap(
        episode.world.robot, episode.joint_position[instants], episode.boxes.movers(instants)
    )
    reach = np.sqrt(module.constants.r) + _ROUNDING
    near = np.flatnonzero(np.asarray(gap) < reach)
    for first in range(0, len(near), _LANES):
        some = near[first : first + _LANES]
        lanes = instants[np.resize(some, _LANES)]
        seen = _ask(
            episode.world,
            module,
            episode.state,
            episode.joint_position[lanes],
            episode.joint_velocity[lanes],
            episode.boxes.movers(lanes),
            episode.boxes.movers(np.maximum(lanes - 1, 0)),
            lanes > 0,
        )
        for whole, part in zip(jax.tree.leaves(found), jax.tree.leaves(seen), strict=True):
            whole[some] = np.asarray(part)[: len(some)]
    return found


_LANES = 16  # instants a call
_ROUNDING = 1e-3  # [m]


@partial(jit, static_argnums=0)
def _gap(robot: Robot, joints: jax.Array, movers: Movers) -> jax.Array:
    """Distance [m] of the arm's surface and the moving boxes."""
    model = robot.moving_spheres

    def gap(q: jax.Array, movers: Movers) -> jax.Array:
        distance = signed_distance(model.world(robot.link_poses(q)), movers.primitives())
        return jnp.min(distance - model.radius)

    return jax.vmap(gap)(joints, movers)


def _once(
    world: World,
    module: DcpRmp,
    state: State,
    q: jax.Array,
    qd: jax.Array,
    now: Movers,
    before: Movers,
    begun: jax.Array,
) -> Reaction:
    previous = world.observe(replace(state, movers=before))
    # The first step has no frame before it.
    carry = Carry(None, previous.scene_points, previous.scene_mask & begun)
    state = replace(state, joint_position=q, joint_velocity=qd, movers=now)
    return module.reaction(world.observe(state), carry)


@partial(jit, static_argnums=0)
def _ask(
    world: World,
    module: DcpRmp,
    state: State,
    q: jax.Array,
    qd: jax.Array,
    now: Movers,
    before: Movers,
    begun: jax.Array,
) -> Reaction:
    return jax.vmap(partial(_once, world, module, state))(q, qd, now, before, begun)
