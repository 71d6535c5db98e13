"""One episode as it happened: what a recording and a video are made from."""

from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction
from typing import TypeVar

import jax
import jax.numpy as jnp
import numpy as np

from drpbench.compile import jit
from drpbench.contract import EPISODE, Movers, Problem
from drpbench.envs import State, World
from drpbench.errors import DrpbenchError
from drpbench.problems import TaskProblems
from drpbench.rollout import Trace
from drpbench.rollout.step import reset

Instant = TypeVar("Instant", int, np.ndarray)


class RecordingError(DrpbenchError):
    """An episode cannot be recorded or drawn; the message is one line."""


@dataclass(frozen=True)
class Boxes:
    """The moving boxes, M of them, at N instants; only `active` ones exist. World frame."""

    half_size: np.ndarray  # (N, M, 3) [m]
    rotation: np.ndarray  # (N, M, 3, 3)
    position: np.ndarray  # (N, M, 3) [m]
    active: np.ndarray  # (N, M) bool

    @property
    def count(self) -> int:
        """M."""
        return self.active.shape[1]

    def movers(self, instants: np.ndarray | slice) -> Movers:
        """The same at chosen instants, for the device. Velocities were not recorded, and are
        zero."""
        fields = {f: jnp.asarray(getattr(self, f)[instants]) for f in _FIELDS}
        return Movers(velocity=jnp.zeros_like(fields["position"]), **fields)


_FIELDS = ("half_size", "rotation", "position", "active")


@dataclass(frozen=True)
class Recording:
    """An episode as it happened, by an arm of J joints.

    T control steps are T + 1 instants, the start first; instant k is k control periods after it. An
    episode whose arm stops being made of finite numbers ends at the instant before.
    """

    world: World
    id: int
    problem: Problem
    state: State
    """The world before the first control step."""
    joint_position: np.ndarray  # (T + 1, J) [rad]
    joint_velocity: np.ndarray  # (T + 1, J) [rad/s], zero at the start
    boxes: Boxes
    sphere: np.ndarray | None = None
    """(T,) index of the sphere of `moving_spheres` nearest to an obstacle in each control step,
    where known"""

    @property
    def task(self) -> str:
        """The name of its task."""
        return self.world.task.name

    @property
    def name(self) -> str:
        """What its files are called."""
        return episode_name(self.task, self.id)

    @property
    def instants(self) -> int:
        """T + 1."""
        return len(self.joint_position)

    def time(self, instant: Instant) -> Instant:
        """When an instant is, or each of several, since the start [ns]."""
        return nanoseconds(instant, self.world.episode.period)


def episode_name(task: str, id: int) -> str:
    """`FDO-00017`."""
    return f"{task}-{id:05d}"


def nanoseconds(instant: Instant, period: float = EPISODE.period) -> Instant:
    """Time of an instant, or of each of them, since the start [ns], without drift; `period` [s]."""
    exact = Fraction(period).limit_denominator(10**6)
    return instant * (10**9 * exact.numerator) // exact.denominator


_reset = jit(reset, static_argnums=(0, 1))


def episode(
    world: World, id: int, problems: TaskProblems, seed: int, arrays: Mapping[str, np.ndarray]
) -> Recording:
    """The episode of one instance from what was recorded of it.

    `arrays` are those of `drpbench.results.Trajectories`, and `sphere` as in a Trace where it is
    known. The rest follows from the problem and the run's seed. Raises RecordingError where arrays
    are missing or not of one number of steps, or begin somewhere else than the problem does.
    """
    problem = jax.tree.map(lambda leaf: leaf[0, ...], problems.take([id]))
    state, joints_count = _reset(world, seed, problem), world.robot.joints
    name = f"the recording of {world.task.name} {id}"
    try:
        joints = np.asarray(arrays["joint_position"], np.float32)
        velocity = np.asarray(arrays["joint_velocity"], np.float32)
        moved = {field: np.asarray(arrays[f"mover_{field}"]) for field in _FIELDS}
    except KeyError as error:
        raise RecordingError(f"{name} lacks {error.args[0]}") from None
    sphere, steps = arrays.get("sphere"), len(velocity)
    first = {field: np.asarray(getattr(state.movers, field)) for field in _FIELDS}
    shapes = (steps + 1, joints_count), (steps, joints_count)
    whole = (joints.shape, velocity.shape) == shapes
    if not whole or any(moved[f].shape != (steps, *first[f].shape) for f in _FIELDS):
        raise RecordingError(f"{name} is damaged: its arrays are not of one number of steps")
    if not np.array_equal(joints[0], problem.start):
        raise RecordingError(f"{name} does not begin where the problem does")
    finite = np.isfinite(joints).all(axis=1)
    end = steps + 1 if finite.all() else int(finite.argmin())
    boxes = {f: np.concatenate([first[f][None], moved[f]])[:end] for f in _FIELDS}
    return Recording(
        world=world,
        id=id,
        problem=problem,
        state=state,
        joint_position=joints[:end],
        joint_velocity=np.concatenate([np.zeros_like(joints[:1]), velocity])[:end],
        boxes=Boxes(**boxes),
        sphere=None if sphere is None else sphere[: end - 1],
    )


def traced(id: int, problems: TaskProblems, seed: int, trace: Trace, lane: int) -> Recording:
    """The episode in one lane of a rollout."""
    arrays = {
        "joint_position": np.concatenate([trace.start[None, lane], trace.joint_position[:, lane]]),
        "joint_velocity": trace.joint_velocity[:, lane],
        "sphere": trace.sphere[:, lane],
    }
    for field in _FIELDS:
        arrays[f"mover_{field}"] = getattr(trace, f"mover_{field}")[:, lane]
    return episode(trace.world, id, problems, seed, arrays)
