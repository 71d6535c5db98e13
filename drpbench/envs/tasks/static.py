"""SE, static environments: a furnished scene, and nothing in it moves."""

from dataclasses import dataclass

from jaxtyping import Array, Int, PRNGKeyArray

from drpbench.contract import Episode, Movers, Problem, no_movers

from ..arm import Arm
from .task import Task


@dataclass(frozen=True)
class Static(Task):
    name: str = "SE"
    title: str = "static environment"
    movers: int = 0
    removal: int = 0
    starts_at_goal: bool = False
    conditional: bool = False

    def reset(
        self, problem: Problem, arm: Arm, key: PRNGKeyArray, episode: Episode
    ) -> tuple[Movers, tuple[()]]:
        return no_movers(0), ()

    def advance(
        self,
        movers: Movers,
        memory: tuple[()],
        problem: Problem,
        arm: Arm,
        clock: Int[Array, ""],
        episode: Episode,
    ) -> tuple[Movers, tuple[()]]:
        return movers, memory
