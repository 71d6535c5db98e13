"""The world: a task, a scene and an arm, as pure functions of one world's state; vmap over
problems."""

from dataclasses import dataclass, replace
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray

from drpbench.contract import (
    EPISODE,
    ROBOT_POINTS,
    Episode,
    Movers,
    Observation,
    Problem,
    Sensor,
    Spec,
    observation_spec,
)
from drpbench.geometry import FAR, Primitives, concatenate
from drpbench.perception import SurfaceCloud
from drpbench.robot import PANDA, Robot

from .arm import Arm
from .contact import contact
from .dynamics import SUBSTEPS, substep
from .random import quickly_compiled
from .tasks.task import Task


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class State:
    """Everything one world is."""

    problem: Problem
    joint_position: Float[Array, "*batch J"]
    joint_velocity: Float[Array, "*batch J"]
    reference: Float[Array, "*batch J"]
    """What the servos aim at [rad]: follows the policy's target at the arm's velocity limits."""
    contact_torque: Float[Array, "*batch J"]
    movers: Movers
    memory: Any
    """The task's own."""
    cloud: Any
    """The sensor's own."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Events:
    """What happened during one control step."""

    clearance: Float[Array, "*batch"]
    """Smallest signed distance [m] between arm and obstacles over the substeps."""
    sphere: Int[Array, "*batch"]
    """The sphere it belongs to, as an index into `robot.moving_spheres`."""
    self_clearance: Float[Array, "*batch"]
    """Smallest distance [m] between links that can touch, at the end."""
    grip_position: Float[Array, "*batch 3"]
    grip_rotation: Float[Array, "*batch 3 3"]
    finite: Bool[Array, "*batch"]
    """Whether the policy's target and the arm's state are numbers."""


@dataclass(frozen=True)
class World:
    """The dynamics and the observation of one task. docs/protocol.md has the whole of it in words.

    A hashable value: the task, the arm, the episode's clock, what makes the scene points of an
    observation, and how many points of the arm itself there are in it. The defaults are the
    benchmark's.
    """

    task: Task
    robot: Robot = PANDA
    episode: Episode = EPISODE
    sensor: Sensor = SurfaceCloud()
    robot_points: int = ROBOT_POINTS

    @property
    def spec(self) -> Spec:
        """What a policy sees of it."""
        return observation_spec(self.robot, self.sensor.points, self.robot_points)

    def reset(self, problem: Problem, key: PRNGKeyArray) -> State:
        """The state before the first control step. All of the episode's randomness is `key`'s."""
        task_key, *sensor_keys = jax.random.split(key, 3)
        start = jnp.asarray(problem.start)
        arm = Arm.of(self.robot, start)
        movers, memory = self.task.reset(problem, arm, task_key, self.episode)
        zeros = jnp.zeros_like(start)
        return State(
            problem=problem,
            joint_position=start,
            joint_velocity=zeros,
            reference=start,
            contact_torque=zeros,
            movers=movers,
            memory=memory,
            cloud=self.sensor.reset(
                (quickly_compiled(sensor_keys[0]), quickly_compiled(sensor_keys[1])),
                problem,
                self.task.movers,
            ),
        )

    def obstacles(self, state: State) -> Primitives:
        """Every obstacle there is: the static scene's, then the moving boxes."""
        return concatenate(state.problem.obstacles, state.movers.primitives())

    def step(
        self, state: State, target: Float[Array, " J"], clock: Int[Array, ""]
    ) -> tuple[State, Events]:
        """One control step. `target` [rad]: absolute joint positions; `clock` counts from 0.

        A target that is not finite is replaced by the last one, and reported.
        """
        robot, period = self.robot, self.episode.period
        movers, memory = self.task.advance(
            state.movers,
            state.memory,
            state.problem,
            Arm.of(robot, state.joint_position),
            clock,
            self.episode,
        )
        state = replace(state, movers=movers, memory=memory)
        obstacles = self.obstacles(state)

        sane = jnp.isfinite(target).all()
        target = jnp.clip(
            jnp.where(sane, target, state.reference), robot.joint_lower, robot.joint_upper
        )
        most = jnp.asarray(robot.velocity_limit * period, target.dtype)
        reference = state.reference + jnp.clip(target - state.reference, -most, most)

        def move(motion: tuple, _: None) -> tuple[tuple, None]:
            q, qd, torque, worst, sphere = motion
            q, qd = substep(q, qd, reference, torque, robot, period)
            poses = robot.link_poses(q)
            touch = contact(poses, qd, robot.moving_spheres.world(poses), obstacles, robot)
            sphere = jnp.where(touch.clearance < worst, touch.sphere, sphere)
            return (q, qd, touch.torque, jnp.minimum(worst, touch.clearance), sphere), None

        motion = (state.joint_position, state.joint_velocity, state.contact_torque)
        begun = (*motion, jnp.float32(FAR), jnp.int32(0))
        (q, qd, torque, clearance, sphere), _ = jax.lax.scan(move, begun, None, length=SUBSTEPS)
        poses = robot.link_poses(q)
        position, rotation = robot.grip_pose(poses)
        state = replace(
            state, joint_position=q, joint_velocity=qd, reference=reference, contact_torque=torque
        )
        return state, Events(
            clearance=clearance,
            sphere=sphere,
            self_clearance=robot.self_clearance(poses),
            grip_position=position,
            grip_rotation=rotation,
            finite=sane & jnp.isfinite(q).all() & jnp.isfinite(qd).all(),
        )

    def observe(self, state: State, privileged: bool = False) -> Observation:
        """What a policy gets to see of the state; the obstacle models only if it is privileged."""
        robot, problem = self.robot, state.problem
        poses = robot.link_poses(state.joint_position)
        points, mask = self.sensor.observe(state.cloud, problem, state.movers, robot, poses)
        return Observation(
            joint_position=state.joint_position,
            joint_velocity=state.joint_velocity,
            goal_joints=jnp.asarray(problem.goal),
            goal_position=jnp.asarray(problem.goal_position),
            goal_quaternion=jnp.asarray(problem.goal_quaternion),
            scene_points=points,
            scene_mask=mask,
            robot_points=robot.surface_points(self.robot_points).world(poses),
            obstacles=self.obstacles(state) if privileged else None,
        )
