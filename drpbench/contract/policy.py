"""The policy protocol: two pure functions for one environment. The runner vmaps and jits them."""

from typing import Any, Protocol, runtime_checkable

from jaxtyping import Array, Float, PRNGKeyArray

from .observation import Observation

Scalar = float | Float[Array, ""]
"""A number among a policy's parameters: a leaf of its pytree, so a traced array inside jit."""

OF_THE_WORLD = ("robot", "control_period")
"""Fields of a policy that the world decides, not the policy: its arm, and how long a control step
is [s]. They are static under jit, are passed by name to whatever makes a policy, and are none of
the parameters that a result states."""
UNSTATED = {"stated": False}
"""Metadata of a policy's field that says something of the machine, and stays out of results."""


@runtime_checkable
class Policy(Protocol):
    """A policy, registered as a JAX pytree: its parameters are its leaves, its settings static.

    `privileged` policies get the obstacle models in `Observation.obstacles`, and are marked so on
    the leaderboard.
    """

    @property
    def privileged(self) -> bool: ...

    def init(self, observation: Observation) -> Any:
        """What the policy carries from step to step, before the first one: any pytree of arrays."""
        ...

    def act(
        self, observation: Observation, carry: Any, key: PRNGKeyArray
    ) -> tuple[Float[Array, " J"], Any]:
        """Absolute joint position targets [rad] for the next control step, and the new carry.

        `key` is the policy's own randomness; it tells nothing of the world's.
        """
        ...
