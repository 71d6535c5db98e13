"""What a file of weights must know of a network: its sizes, its parameters' shapes, its policy."""

from collections.abc import Mapping
from dataclasses import fields
from typing import Any, Protocol, runtime_checkable

from drpbench.contract import Policy
from drpbench.robot import PANDA, Robot


@runtime_checkable
class Network(Protocol):
    """A network of one size: a frozen dataclass whose fields are the sizes.

    Parameters are a pytree of float32 arrays. Whoever inherits from this class writes `shapes` and
    `policy`; the other methods have defaults.
    """

    @classmethod
    def format(cls) -> str:
        """Names the network and its layout in a file. The default is the class's import path."""
        return f"{cls.__module__}:{cls.__qualname__}"

    @classmethod
    def title(cls) -> str:
        """The network's name on a model card."""
        return cls.__name__

    def settings(self) -> dict[str, Any]:
        """The sizes, as a file and a card state them: values that JSON holds. The arm is none."""
        values = ((f.name, getattr(self, f.name)) for f in fields(self))  # type: ignore[arg-type]
        return {name: value for name, value in values if name != "robot"}

    @classmethod
    def from_settings(cls, settings: Mapping[str, Any], robot: Robot = PANDA) -> "Network":
        """The network that `settings` describes, as JSON has it; a size that is absent has its
        default.

        One with a field `robot` is for that arm. Raises ValueError or TypeError.
        """
        names = [field.name for field in fields(cls)]  # type: ignore[arg-type]
        arm = {"robot": robot} if "robot" in names else {}
        names = [name for name in names if name != "robot"]
        if unknown := settings.keys() - set(names):
            raise ValueError(f"expected {', '.join(names) or 'none'}, got {sorted(unknown)[0]}")
        # JSON has no tuples, and lists cannot be hashed.
        sizes = {k: tuple(v) if isinstance(v, list) else v for k, v in settings.items()}
        return cls(**sizes, **arm)

    def shapes(self) -> Any:
        """The tree of the parameters, with a shape and type in place of each array."""
        ...

    def policy(self, parameters: Any, weights: str = "") -> Policy:
        """The policy with these parameters. `weights` is the SHA-256 of the file that they came
        from."""
        ...
