"""The world: a task, a scene and an arm, as pure functions of one world's state; vmap over problems."""

from dataclasses import dataclass, replace
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray

from drpbench.geometry import FAR, Primitives, concatenate
from drpbench.robot import (
    JOINT_LOWER,
    JOINT_UPPER,
    VELOCITY_LIMIT,
    grip_pose,
    link_poses,
    moving_spheres,
    self_clearance,
)

from .cloud import Cloud, robot_points, sample_static, scene_cloud, shares
from .contact import contact
from .dynamics import CONTROL_PERIOD, SUBSTEPS, substep
from .movers import Movers
from .observation import Observation
from .problem import Problem
from .random import quickly_compiled
from .tasks import Arm, Task


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class State:
    """Everything one world is."""

    problem: Problem
    joint_position: Float[Array, "*batch 7"]
    joint_velocity: Float[Array, "*batch 7"]
    reference: Float[Array, "*batch 7"]
    """What the servos aim at [rad]: follows the policy's target at the arm's velocity limits."""
    contact_torque: Float[Array, "*batch 7"]
    movers: Movers
    memory: Any
    """The task's own."""
    cloud: Cloud


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Events:
    """What happened during one control step."""

    clearance: Float[Array, "*batch"]
    """Smallest signed distance [m] between arm and obstacles over the substeps."""
    sphere: Int[Array, "*batch"]
    """The sphere it belongs to, as an index into `moving_spheres()`."""
    self_clearance: Float[Array, "*batch"]
    """Smallest distance [m] between links that can touch, at the end."""
    grip_position: Float[Array, "*batch 3"]
    grip_rotation: Float[Array, "*batch 3 3"]
    finite: Bool[Array, "*batch"]
    """Whether the policy's target and the arm's state are numbers."""


def _arm(joint_position: Float[Array, "7"]) -> Arm:
    poses = link_poses(joint_position)
    spheres = moving_spheres()
    return Arm(spheres.world(poses), jnp.asarray(spheres.radius), grip_pose(poses)[0])


@dataclass(frozen=True)
class World:
    """The dynamics and the observation of one task. docs/protocol.md has the whole of it in words."""

    task: Task

    def reset(self, problem: Problem, key: PRNGKeyArray) -> State:
        """The state before the first control step. All of the episode's randomness is `key`'s."""
        task_key, static_key, mover_key = jax.random.split(quickly_compiled(key), 3)
        start = jnp.asarray(problem.start)
        arm = _arm(start)
        movers, memory = self.task.reset(problem, arm, task_key)
        on_static, on_each = shares(self.task.movers)
        points, mask = sample_static(static_key, problem.obstacles, on_static)
        tickets = jax.random.uniform(mover_key, (self.task.movers, on_each, 3))
        zeros = jnp.zeros_like(start)
        return State(
            problem=problem,
            joint_position=start,
            joint_velocity=zeros,
            reference=start,
            contact_torque=zeros,
            movers=movers,
            memory=memory,
            cloud=Cloud(points, mask, tickets),
        )

    def obstacles(self, state: State) -> Primitives:
        """Every obstacle there is: the static scene's, then the moving boxes."""
        return concatenate(state.problem.obstacles, state.movers.primitives())

    def step(
        self, state: State, target: Float[Array, "7"], clock: Int[Array, ""]
    ) -> tuple[State, Events]:
        """One control step, 1/60 s. `target` [rad]: absolute joint positions; `clock` counts from 0.

        A target that is not finite is replaced by the last one, and reported.
        """
        arm = _arm(state.joint_position)
        movers, memory = self.task.advance(state.movers, state.memory, state.problem, arm, clock)
        state = replace(state, movers=movers, memory=memory)
        obstacles = self.obstacles(state)

        sane = jnp.isfinite(target).all()
        target = jnp.clip(jnp.where(sane, target, state.reference), JOINT_LOWER, JOINT_UPPER)
        most = jnp.asarray(VELOCITY_LIMIT * CONTROL_PERIOD, target.dtype)
        reference = state.reference + jnp.clip(target - state.reference, -most, most)

        def move(motion, _):
            q, qd, torque, worst, sphere = motion
            q, qd = substep(q, qd, reference, torque)
            poses = link_poses(q)
            touch = contact(poses, qd, moving_spheres().world(poses), obstacles)
            sphere = jnp.where(touch.clearance < worst, touch.sphere, sphere)
            return (q, qd, touch.torque, jnp.minimum(worst, touch.clearance), sphere), None

        motion = (state.joint_position, state.joint_velocity, state.contact_torque)
        motion = (*motion, jnp.float32(FAR), jnp.int32(0))
        (q, qd, torque, clearance, sphere), _ = jax.lax.scan(move, motion, None, length=SUBSTEPS)
        poses = link_poses(q)
        position, rotation = grip_pose(poses)
        state = replace(
            state, joint_position=q, joint_velocity=qd, reference=reference, contact_torque=torque
        )
        return state, Events(
            clearance=clearance,
            sphere=sphere,
            self_clearance=self_clearance(poses),
            grip_position=position,
            grip_rotation=rotation,
            finite=sane & jnp.isfinite(q).all() & jnp.isfinite(qd).all(),
        )

    def observe(self, state: State, privileged: bool = False) -> Observation:
        """What a policy gets to see of the state; the obstacle models only if it is privileged."""
        points, mask = scene_cloud(state.cloud, state.movers)
        return Observation(
            joint_position=state.joint_position,
            joint_velocity=state.joint_velocity,
            goal_joints=state.problem.goal,
            goal_position=state.problem.goal_position,
            goal_quaternion=state.problem.goal_quaternion,
            scene_points=points,
            scene_mask=mask,
            robot_points=robot_points().world(link_poses(state.joint_position)),
            obstacles=self.obstacles(state) if privileged else None,
        )
