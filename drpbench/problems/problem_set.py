"""A whole problem set as a value: for which arm, what surrounds it, and the problems of each
task."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from drpbench.robot import Robot
from drpbench.robot.arms import arm

from .task_problems import ProblemSetError, TaskProblems


@dataclass(frozen=True, eq=False)
class ProblemSet:
    """Problems by task, in the order that they are run and shown.

    Attributes:
        sha256: checksum of the content. Results of two sets are never compared.
        arm: name of the arm, see `drpbench.robot.ARMS`.
        finger_opening: [m] of each finger from the middle.
        ground: whether the arm stands on a table or floor at z = 0. No sensor sees a point below
            it.
    """

    name: str
    sha256: str
    problems: Mapping[str, TaskProblems]
    arm: str = "panda"
    finger_opening: float = 0.04
    ground: bool = True

    @property
    def tasks(self) -> tuple[str, ...]:
        """The names of the tasks that it has problems of."""
        return tuple(self.problems)

    @property
    def counts(self) -> dict[str, int]:
        """The number of problems of each task."""
        return {task: problems.count for task, problems in self.problems.items()}

    @property
    def robot(self) -> Robot:
        """The arm that the problems are for."""
        return arm(self.arm, self.finger_opening)

    def task(self, name: str) -> TaskProblems:
        """The problems of one task. Raises ProblemSetError where it has none."""
        if name not in self.problems:
            raise ProblemSetError(
                f"there is no task {name!r} in {self.name}; its tasks are {', '.join(self.tasks)}"
            )
        return self.problems[name]
