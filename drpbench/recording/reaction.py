"""What DCP-RMP made of an episode: the dynamic closest point and the modified goal, seen again."""

from collections.abc import Mapping
from dataclasses import fields

import jax
import jax.numpy as jnp
import numpy as np

from drpbench.compile import jit
from drpbench.envs import Movers, Observation, State
from drpbench.envs.cloud import robot_points, scene_cloud
from drpbench.policies import DcpRmp, Reaction
from drpbench.policies.dcp_rmp import Carry, Constants
from drpbench.robot import link_poses

from .episode import Episode


def dcp_rmp_of(parameters: Mapping[str, object]) -> DcpRmp | None:
    """The DCP-RMP that goes over a policy, by the parameters in a result's header. None without one.

    What it goes over is left out: the modified goal does not depend on it.
    """
    names = [field.name for field in fields(Constants)]
    if not all(f"constants.{name}" in parameters for name in names):
        return None
    constants = Constants(**{name: parameters[f"constants.{name}"] for name in names})
    return DcpRmp(policy=None, constants=constants)


def reaction(module: DcpRmp, episode: Episode, instants: np.ndarray) -> Reaction:
    """Asks the module again at the instants (N,) given, each with the cloud of the instant before."""
    found = _ask(
        module,
        episode.state,
        episode.joint_position[instants],
        episode.joint_velocity[instants],
        episode.boxes.movers(instants),
        episode.boxes.movers(np.maximum(instants - 1, 0)),
        instants > 0,
    )
    return jax.tree.map(np.asarray, found)


def _once(
    module: DcpRmp,
    state: State,
    q: jax.Array,
    qd: jax.Array,
    now: Movers,
    before: Movers,
    begun: jax.Array,
) -> Reaction:
    points, mask = scene_cloud(state.cloud, now)
    previous, previous_mask = scene_cloud(state.cloud, before)
    carry = Carry(None, previous, previous_mask & begun)  # the first step has no frame before it
    observation = Observation(
        joint_position=q,
        joint_velocity=qd,
        goal_joints=jnp.asarray(state.problem.goal),
        goal_position=jnp.asarray(state.problem.goal_position),
        goal_quaternion=jnp.asarray(state.problem.goal_quaternion),
        scene_points=points,
        scene_mask=mask,
        robot_points=robot_points().world(link_poses(q)),
    )
    return module.reaction(observation, carry)


_ask = jit(jax.vmap(_once, in_axes=(None, None, 0, 0, 0, 0, 0)))
