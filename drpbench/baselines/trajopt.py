"""The project's own trajectory optimiser as a policy: `trajopt`, and `trajopt-vox` on voxels.

At the start it plans to the goal with `drpbench.planning.expert`, gives the path its times within
the arm's limits (`retiming.retime`), and tracks it. Every few control steps it looks whether what
is left of the plan is still free among the obstacles as they stand, and plans anew from where the
arm is if it is not: with the rest of the old path as a hint, and to a place to stop before the goal
where the goal itself is taken. It knows no motion: obstacles are taken to stay where they are. In
the manner of cuRobo (Sundaralingam et al., 2023), which it is not.

With privilege it plans on the obstacle models. Without, on a grid of voxels in which there is a
point of the cloud: the paper's cuRobo-Vox has such a grid too, of the same size.
"""

from dataclasses import dataclass, field, replace

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray

from drpbench.contract import EPISODE, Observation, Scalar
from drpbench.geometry import Field, VoxelField
from drpbench.planning.clearance_cost import gaps
from drpbench.planning.expert import PlannerSettings, plan
from drpbench.planning.polyline import between
from drpbench.planning.retiming import retime
from drpbench.robot import PANDA, Robot

from .replanning import planned_where

FIRST = PlannerSettings(iterations=30, vias=11, stop_short=True)
AGAIN = PlannerSettings(iterations=15, vias=5, stop_short=True)
_VOXEL = 0.05  # [m]
_GRID = (40, 40, 40)
_CORNER = (-1.0, -1.0, -0.8)  # [m] in the arm's base frame: as far below it as a low floor
_SAMPLES = 256  # of a trajectory
_LOOKED_AT = 32  # of what is left of one


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Following:
    """The trajectory that is tracked, and how far."""

    q: Float[Array, "*batch N J"]
    """[rad] at equal steps of time"""
    duration: Float[Array, "*batch"]  # [s]
    room: Float[Array, "*batch"]
    """[m] The smallest clearance of the plan when it was made."""
    reached: Bool[Array, "*batch"]
    """Whether it ends at the goal."""
    since: Float[Array, "*batch"]
    """[s] since it was begun"""
    clock: Int[Array, "*batch"]
    """control steps of the episode"""

    def at(self, times: Float[Array, " L"]) -> Float[Array, "L J"]:
        """The trajectory at some instants [s], its end after it."""
        share = jnp.clip(times / self.duration, 0.0, 1.0)
        return between(self.q, share * (len(self.q) - 1))


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class TrajOpt:
    """Plans, tracks, and plans anew where the plan is no longer free."""

    speed: Scalar = 0.5
    """Share of the pace that the arm's limits allow."""
    room: Scalar = 0.03
    """[m] of clearance below which a plan that had more is made anew."""
    replan: int = field(default=15, metadata={"static": True})
    """Control steps between two looks at the plan; 0: it never looks again."""
    first: PlannerSettings = field(default=FIRST, metadata={"static": True})
    """Of the plan that an episode begins with."""
    again: PlannerSettings = field(default=AGAIN, metadata={"static": True})
    """Of a plan that is made under way."""
    privileged: bool = field(default=True, metadata={"static": True})
    """Whether it plans on the obstacle models; else on voxels of the point cloud."""
    robot: Robot = field(default=PANDA, metadata={"static": True})
    control_period: float = field(default=EPISODE.period, metadata={"static": True})

    def init(self, observation: Observation) -> Following:
        q = observation.joint_position
        rest = jnp.broadcast_to(q, (_SAMPLES, len(q)))
        still = Following(
            rest,
            jnp.float32(1.0),
            jnp.float32(0.0),
            jnp.bool_(False),
            jnp.float32(0.0),
            jnp.int32(0),
        )
        return self._planned(observation, still, self.first)

    def act(
        self, observation: Observation, carry: Following, key: PRNGKeyArray | None
    ) -> tuple[Float[Array, " J"], Following]:
        if self.replan:
            looks = (carry.clock % self.replan == 0) & (carry.clock > 0)
            carry = planned_where(looks, self._looked, observation, carry)
        ahead = carry.since + self.robot.servo_lag
        (target,) = carry.at(self.speed * ahead[None])
        step = jnp.float32(self.control_period)
        return target, replace(carry, since=carry.since + step, clock=carry.clock + 1)

    def _looked(self, observation: Observation, old: Following) -> Following:
        spoilt = self._spoilt(observation, old)
        return planned_where(spoilt, self._again, observation, old)

    def _again(self, observation: Observation, old: Following) -> Following:
        return self._planned(observation, old, self.again)

    def _planned(
        self, observation: Observation, old: Following, settings: PlannerSettings
    ) -> Following:
        """The best plan from where the arm is; the old one where none is found."""
        rest = old.at(self._left(old))
        found = plan(
            self._field(observation),
            observation.joint_position,
            observation.goal_joints,
            jax.random.key(0),
            rest[None],
            settings,
            self.robot,
        )
        timed = retime(jnp.asarray(found.path), _SAMPLES, self.robot)
        new = Following(
            jnp.asarray(timed.q),
            jnp.maximum(timed.duration, 1e-3),
            jnp.asarray(found.clearance),
            jnp.asarray(found.reached),
            jnp.zeros_like(old.since),
            old.clock,
        )
        return jax.tree.map(lambda a, b: jnp.where(found.success, a, b), new, old)

    def _left(self, carry: Following) -> Float[Array, " L"]:
        """Instants [s of the trajectory] of what is left of it."""
        now = jnp.minimum(self.speed * carry.since, carry.duration)
        return now + (carry.duration - now) * jnp.linspace(0.0, 1.0, _LOOKED_AT)

    def _spoilt(self, observation: Observation, carry: Following) -> Bool[Array, ""]:
        """Whether what is left comes nearer to an obstacle than it should, or the goal, which was
        taken, may be free now."""
        rest = carry.at(self._left(carry))
        ends = jnp.concatenate([rest, observation.goal_joints[None]])
        obstacles = self._field(observation)
        room = jax.vmap(lambda q: jnp.min(gaps(q, obstacles, self.robot).obstacle))(ends)
        least = jnp.minimum(self.room, 0.7 * jnp.maximum(carry.room, 0.0))
        return (jnp.min(room[:-1]) < least) | (~carry.reached & (room[-1] > 0.0))

    def _field(self, observation: Observation) -> Field:
        if not self.privileged:
            points, mask = observation.scene_points, observation.scene_mask
            return VoxelField.of_points(points, mask, _GRID, _VOXEL, _CORNER)
        assert observation.obstacles is not None
        return observation.obstacles
