"""SE, static environments: a furnished scene, and nothing in it moves."""

from dataclasses import dataclass

import jax.numpy as jnp

from drpbench.contract import no_movers


@dataclass(frozen=True)
class Static:
    name: str = "SE"
    title: str = "static environment"
    movers: int = 0
    rehearsed: bool = False
    stays: bool = False
    conditional: bool = False
    training_levels: tuple[tuple[int, ...], tuple[int, ...]] = ((1,), (2,))

    def reset(self, problem, arm, key):
        return no_movers(0), ()

    def advance(self, movers, memory, problem, arm, clock):
        return movers, memory

    def valid(self, memory):
        return jnp.bool_(True)
