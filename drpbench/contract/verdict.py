"""When an episode counts as reached, and what its verdict is: the one place that says so."""

import math
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import jax
import numpy as np
from jaxtyping import Array, Bool, Float, Int

REACH_POSITION = 0.01  # [m]
REACH_POSITION_LOOSE = 0.05  # [m] the reference evaluator's
REACH_ORIENTATION = math.radians(15.0)

Flags = Bool[Array, "*shape"] | Bool[np.ndarray, "*shape"] | np.bool_
Steps = Int[Array, "*shape"] | Int[np.ndarray, "*shape"] | np.integer
Lengths = Float[Array, "*shape"] | Float[np.ndarray, "*shape"] | np.floating


def reached(
    position_error: Lengths, orientation_error: Lengths, position: float = REACH_POSITION
) -> Flags:
    """Whether `grip` is at its goal: nearer than `position` [m] and than 15 degrees.

    `position_error` [m] and `orientation_error` [rad] are of one shape, NumPy's or JAX's.
    """
    return (position_error < position) & (orientation_error < REACH_ORIENTATION)


@runtime_checkable
class Measured(Protocol):
    """What a verdict looks at, of one control step or of many."""

    @property
    def position_error(self) -> Any:
        """[m] of `grip` from the goal."""

    @property
    def orientation_error(self) -> Any:
        """[rad]"""

    @property
    def clearance(self) -> Any:
        """[m] smallest signed distance of arm and obstacles during the step."""

    @property
    def finite(self) -> Any:
        """Whether the target and the state are numbers."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Verdict:
    """How episodes stand after a control step; after the last one it is their outcome.

    Arrays of one shape, one entry an episode, NumPy's or JAX's.
    """

    reached: Flags
    """At the goal after this step. An episode that is not `finite` has not reached it."""
    first_collision_step: Steps
    """The first control step in which the arm touched an obstacle; -1 where it touched none."""
    finite: Flags
    """Every target and every state so far was made of numbers; an episode that was not has failed.
    """
    valid: Flags
    """Whether the episode is an instance of its task so far (GB: whether the goal was blocked)."""

    @property
    def collided(self) -> Flags:
        """The arm touched an obstacle in this step or an earlier one."""
        return self.first_collision_step >= 0

    @property
    def success(self) -> Flags:
        """Reached, and never collided."""
        return self.reached & ~self.collided

    @classmethod
    def begin(cls, shape: tuple[int, ...] = ()) -> "Verdict":
        """The verdict on `shape` episodes before their first control step."""
        no = np.zeros(shape, bool)
        return cls(
            reached=no, first_collision_step=np.full(shape, -1, np.int32), finite=~no, valid=~no
        )

    def after(self, step: Measured, valid: Flags, clock: Any) -> "Verdict":
        """The verdict after one control step more, number `clock`; `valid` as the task says now."""
        finite = self.finite & step.finite
        first = self.first_collision_step
        begins = (step.clearance < 0.0) & ~self.collided
        return Verdict(
            reached=reached(step.position_error, step.orientation_error) & finite,
            first_collision_step=first + begins * (clock - first),
            finite=finite,
            valid=valid,
        )

    @classmethod
    def of(cls, steps: Measured, valid: Flags) -> "Verdict":
        """The verdict on whole episodes: arrays of `steps` have time as their first axis.

        `after` for every step in turn gives the same.
        """
        finite = steps.finite.all(axis=0)
        touching = steps.clearance < 0.0
        return cls(
            reached=reached(steps.position_error[-1], steps.orientation_error[-1]) & finite,
            # Where nothing touches, argmax is 0, and one less is -1.
            first_collision_step=touching.argmax(axis=0) - ~touching.any(axis=0),
            finite=finite,
            valid=valid,
        )
