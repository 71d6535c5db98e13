"""The policy protocol: two pure functions for one environment. The runner vmaps and jits them."""

from dataclasses import Field, field
from typing import Any, Protocol, runtime_checkable

from jaxtyping import Array, Float, PRNGKeyArray

from .observation import Observation

Scalar = float | Float[Array, ""]
"""A number among a policy's parameters: a leaf of its pytree, so a traced array inside jit."""

_WORLDS = "of the world"


def of_the_world(default: Any) -> Any:
    """A dataclass field that the world decides, not the policy: its arm (`robot`), or how long a control
    step is (`control_period` [s]). Static under jit, and none of the parameters that a result states."""
    return field(default=default, metadata={"static": True, _WORLDS: True})


def is_of_the_world(of: Field) -> bool:
    """Whether a field was made by `of_the_world`."""
    return _WORLDS in of.metadata


@runtime_checkable
class Policy(Protocol):
    """A policy, registered as a JAX pytree: its parameters are its leaves, its settings static.

    `privileged` policies get the obstacle models in `Observation.obstacles`, and are marked so on the
    leaderboard.
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
