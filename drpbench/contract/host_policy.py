"""Host policies: ordinary Python objects, stepped outside jit, a batch of instances at a time."""

from typing import Any, Protocol, runtime_checkable

from .observation import OBSERVED


class HostObservation:
    """What B instances show, in the world frame (the arm's base), as arrays of the policy's own
    kind.

    Its attributes are those of `observation_spec`, each with the B instances in front, and
    `obstacles`: every obstacle as it is for a privileged policy, otherwise None. They are the
    policy's to keep and to write on.
    """

    def __init__(self, *, obstacles: Any = None, **arrays: Any):
        """Raises TypeError unless `arrays` are those of the spec."""
        if arrays.keys() != set(OBSERVED):
            raise TypeError(
                f"expected the arrays {', '.join(OBSERVED)}, got {', '.join(arrays) or 'none'}"
            )
        for name in OBSERVED:
            setattr(self, name, arrays[name])
        self.obstacles = obstacles

    def __getattr__(self, name: str) -> Any:
        raise AttributeError(
            f"an observation has no {name!r}; it has: {', '.join((*OBSERVED, 'obstacles'))}"
        )


@runtime_checkable
class HostPolicy(Protocol):
    """A policy that is stepped outside jit. The attributes `arrays` and `privileged` may be left
    out, and so may `failures`: after `reset` a text an episode, why it is given up, or ""."""

    def reset(self, observation: HostObservation) -> None:
        """B episodes begin, and this is what they show. Whatever was kept of others is void."""
        ...

    def act(self, observation: HostObservation) -> Any:
        """Absolute joint position targets (B, J) [rad] for the next control step."""
        ...
