"""The referee: recorded episodes once more, against the arm's real meshes, in C MuJoCo.

The benchmark's verdict comes from spheres around the links and a signed distance on the device. The
referee knows neither: it puts the recorded joint positions into MuJoCo's own arm with its collision
meshes, the obstacles beside it as geoms, and asks MuJoCo's collision detection. Both look at the
same 2000 instants of an episode: the end of each control step, as recorded, and its middle, which
the recorded velocity leads back to. Obstacles move at the start of a control step, so the middle
sees them where the end does.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from drpbench.contract import EPISODE
from drpbench.errors import DrpbenchError
from drpbench.geometry import Obstacles
from drpbench.problems import ProblemSet, ProblemSetError, TaskProblems, matching
from drpbench.ranking import wilson
from drpbench.results import Result, Row
from drpbench.robot import PANDA, Robot

if TYPE_CHECKING:
    from drpbench.planning.checker import Checker

MARGIN = 0.03  # [m] the largest clearance that is told apart
COVER_TOLERANCE = 0.003  # [m] what the spheres may leave of a mesh's surface uncovered
DEEPEST_MISSED = 0.005  # [m] a contact deeper than this must not be missed
_STANDS_OUT = (0.005, 0.010, 0.015)  # [m] bounds of the classes of true clearance


class RefereeError(DrpbenchError):
    """Episodes cannot be judged; the message is one line."""


@dataclass(frozen=True)
class Judgement:
    """One episode: the benchmark's verdict, and what the meshes did.

    `clearance` [m] is the smallest distance of any mesh (link1 to the fingers) to any obstacle over
    the episode, at most `MARGIN`; negative is the deepest penetration. `first_step` is the control
    step of the first true contact and `link` what touched; `closest_step` and `closest_link` belong
    to `clearance` and are None where nothing came within the margin.
    """

    row: Row
    clearance: float
    first_step: int | None
    link: str | None
    closest_step: int | None
    closest_link: str | None

    @property
    def collided(self) -> bool:
        """Whether the meshes touched an obstacle."""
        return self.clearance < 0.0

    @property
    def depth(self) -> float:
        """Deepest penetration [m], zero without contact."""
        return max(0.0, -self.clearance)

    @property
    def agrees(self) -> bool:
        """Whether both say collided, or both say free."""
        return self.collided == self.row.collided

    @property
    def disagreement(self) -> str | None:
        """Why the verdicts differ, or None where they agree."""
        if self.agrees:
            return None
        if self.row.collided:
            for low, high in zip((0.0, *_STANDS_OUT), _STANDS_OUT, strict=False):
                if self.clearance < high:
                    return (
                        "spheres stand out from the meshes: "
                        f"true clearance {1e3 * low:g} to {1e3 * high:g} mm"
                    )
            return f"spheres alone, true clearance over {1e3 * _STANDS_OUT[-1]:g} mm"
        if self.depth <= COVER_TOLERANCE:
            return f"meshes alone, by up to {1e3 * COVER_TOLERANCE:g} mm: the cover's tolerance"
        if self.depth <= DEEPEST_MISSED:
            return f"meshes alone, by {1e3 * COVER_TOLERANCE:g} to {1e3 * DEEPEST_MISSED:g} mm"
        return f"meshes alone, deeper than {1e3 * DEEPEST_MISSED:g} mm"


@dataclass(frozen=True)
class Agreement:
    """The judgements of a run in figures."""

    episodes: int
    agreed: int
    interval: tuple[float, float]
    """Wilson's 95 % bounds of the share that agreed."""
    both_collided: int
    both_free: int
    disagreements: dict[str, int]
    """Episodes by class, the most frequent first."""
    deepest_missed: Judgement | None
    """The deepest contact that the spheres missed."""

    def summary(self) -> dict[str, list[tuple[str, str]]]:
        """The figures in words, by section."""
        low, high = self.interval
        share = self.agreed / self.episodes if self.episodes else float("nan")
        missed = "none"
        if self.deepest_missed:
            worst = self.deepest_missed
            missed = (
                f"{1e3 * worst.depth:.1f} mm, {worst.closest_link} in {_name(worst.row)} "
                f"at step {worst.closest_step}"
            )
        return {
            "Spheres and meshes": [
                (
                    "agree",
                    f"{self.agreed}/{self.episodes}, {share:.1%} ({low:.1%} to {high:.1%})",
                ),
                ("both collided", str(self.both_collided)),
                ("both free", str(self.both_free)),
                ("deepest contact missed", missed),
            ],
            "Why they differ": [(name, str(count)) for name, count in self.disagreements.items()]
            or [("they do not", "")],
        }


def agreement(judgements: Sequence[Judgement]) -> Agreement:
    """Counts over episodes."""
    agreed = [j for j in judgements if j.agrees]
    classes = [j.disagreement for j in judgements if j.disagreement]
    missed = [j for j in judgements if j.collided and not j.row.collided]
    return Agreement(
        episodes=len(judgements),
        agreed=len(agreed),
        interval=wilson(len(agreed), len(judgements)),
        both_collided=sum(j.collided for j in agreed),
        both_free=sum(not j.collided for j in agreed),
        disagreements={
            name: classes.count(name)
            for name in sorted(set(classes), key=lambda c: -classes.count(c))
        },
        deepest_missed=max(missed, key=lambda j: j.depth, default=None),
    )


def judge(
    result: Result,
    trajectories: Mapping[str, Mapping[str, np.ndarray]],
    problem_set: ProblemSet,
) -> list[Judgement]:
    """Judges every row of a run, in the order of the rows: `judgements` as a list."""
    return list(judgements(result, trajectories, problem_set))


def judgements(
    result: Result,
    trajectories: Mapping[str, Mapping[str, np.ndarray]],
    problem_set: ProblemSet,
) -> Iterator[Judgement]:
    """Judges the rows of a run one by one.

    `trajectories` is what `load_trajectories` returns for the run's NPZ, `problem_set` what the run
    was made on. Raises RefereeError, before anything is replayed, where the meshes are not found, a
    recording is missing, or the problems are not those of the run.
    """
    try:
        matching(result.header.problem_set, result.header.problem_set_sha256, problem_set)
    except ProblemSetError as error:
        raise RefereeError(f"the run was {error}; run it again") from None
    absent = [row for row in result.rows if _name(row) not in trajectories]
    if absent:
        raise RefereeError(
            f"{len(absent)} of {len(result.rows)} episodes were not recorded (first: "
            f"{_name(absent[0])}); run again with --save-trajectories"
        )
    checker = mesh_referee()
    for row in result.rows:
        yield judge_episode(row, trajectories[_name(row)], problem_set.task(row.task), checker)


def mesh_referee(robot: Robot = PANDA) -> Checker:
    """MuJoCo with the arm's real meshes. RefereeError where they are not found."""
    from drpbench.planning.checker import Checker

    if robot.meshes is None:
        raise RefereeError(f"no real meshes of {robot.name} are known; the Panda has some")
    model = robot.meshes.find()
    if model is None:
        raise RefereeError(robot.meshes.absent)
    return Checker(robot.meshes.spec(model), MARGIN)


def judge_episode(
    row: Row,
    trajectory: Mapping[str, np.ndarray],
    problems: TaskProblems,
    checker: Checker,
    period: float = EPISODE.period,
) -> Judgement:
    """Judges one recorded episode, up to its first instant that is not finite; `period` [s] of
    control.

    The deepest penetration is that of one convex piece of a link (all but link5 and the fingers are
    one piece). Raises RefereeError for a recording that is not of the form `trajectories.py`
    states.
    """
    joints, velocity, movers = _read(row, trajectory, problems.start.shape[1])
    # MuJoCo's integrators add the new velocity: q_end = q_middle + v_end h.
    middle = joints - velocity * period / 2
    scene = problems.obstacles[row.id].present()
    nearest, closest_step, closest_link = checker.margin, None, None
    first_step = link = None
    for step in range(len(joints)):
        if not np.isfinite(joints[step]).all():
            break
        if step == 0 or movers.changed[step]:
            checker.set_obstacles(scene.joined(movers.at(step)))
        for q in (middle[step], joints[step]):
            found = _closest(checker, q)
            if found is None or found[1] >= nearest:
                continue
            if nearest >= 0.0 > found[1]:
                first_step, link = step, found[0]
            (closest_link, nearest), closest_step = found, step
    return Judgement(row, nearest, first_step, link, closest_step, closest_link)


def _closest(checker: Checker, q: np.ndarray) -> tuple[str, float] | None:
    """The link nearest to an obstacle and its distance [m], None where none is within the
    margin."""
    for first, second, distance in checker.contacts(q):  # sorted by distance
        names = [n for n in (first, second) if not n.startswith("obstacle")]
        if len(names) == 1:  # two: the arm with itself, which the verdict reports apart
            return names[0], distance
    return None


@dataclass(frozen=True)
class _Movers:
    """The moving boxes of an episode: (T, M, ...) arrays; quaternions wxyz."""

    half_size: np.ndarray
    position: np.ndarray
    quaternion: np.ndarray
    active: np.ndarray
    changed: np.ndarray  # (T,) bool: anything but as in the step before

    def at(self, step: int) -> Obstacles:
        """The boxes that exist in a control step."""
        on = self.active[step]
        return Obstacles.boxes(
            self.half_size[step][on], self.position[step][on], self.quaternion[step][on]
        )


def _read(
    row: Row, trajectory: Mapping[str, np.ndarray], count: int
) -> tuple[np.ndarray, np.ndarray, _Movers]:
    """Positions and velocities (T, J) of `count` joints at the ends of the control steps, and the
    moving boxes."""
    try:
        joints = np.asarray(trajectory["joint_position"], float)[1:]
        velocity = np.asarray(trajectory["joint_velocity"], float)
        position = np.asarray(trajectory["mover_position"], float)
        active = np.asarray(trajectory["mover_active"], bool)
        steps, boxes = active.shape
        half_size = np.asarray(trajectory["mover_half_size"], float).reshape(steps, boxes, 3)
        rotation = np.asarray(trajectory["mover_rotation"], float).reshape(steps, boxes, 3, 3)
        shapes = joints.shape, velocity.shape, position.shape
        if shapes != ((steps, count), (steps, count), (steps, boxes, 3)):
            raise ValueError
    except KeyError as error:
        raise RefereeError(f"the recording of {_name(row)} lacks {error.args[0]}") from None
    except ValueError:
        raise RefereeError(
            f"the recording of {_name(row)} is damaged: its arrays are not of one number of steps"
        ) from None
    quaternion = _quaternions(rotation)
    changed = np.zeros(steps, bool)
    for values in (half_size, position, quaternion, active):
        changed[1:] |= (values[1:] != values[:-1]).any(axis=tuple(range(1, values.ndim)))
    return joints, velocity, _Movers(half_size, position, quaternion, active, changed)


def _quaternions(rotation: np.ndarray) -> np.ndarray:
    """Quaternions (T, M, 4) wxyz of rotation matrices (T, M, 3, 3)."""
    from scipy.spatial.transform import Rotation

    if rotation.size == 0:
        return np.zeros((*rotation.shape[:2], 4))
    flat = Rotation.from_matrix(rotation.reshape(-1, 3, 3)).as_quat(scalar_first=True)
    return flat.reshape(*rotation.shape[:2], 4)


def _name(row: Row) -> str:
    return f"{row.task}-{row.id}"
