"""SE, static environments: a furnished scene, and nothing in it moves."""

from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Int, PRNGKeyArray

from drpbench.contract import Episode, Movers, Problem, no_movers

from ..arm import Arm


@dataclass(frozen=True)
class Static:
    name: str = "SE"
    title: str = "static environment"
    movers: int = 0
    rehearsed: bool = False
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

    def valid(self, memory: tuple[()]) -> Bool[Array, ""]:
        return jnp.bool_(True)

    def training_level(
        self, number: Int[np.ndarray, " n"], furnished: Bool[np.ndarray, " n"]
    ) -> Int[np.ndarray, " n"]:
        return np.where(furnished, 2, 1)
