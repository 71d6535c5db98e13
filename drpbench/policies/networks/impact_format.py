"""IMPACT as a file of weights knows it."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from typing import Any

from drpbench.robot import PANDA, Robot

from .impact import shapes
from .impact_policy import Impact
from .impact_size import ImpactSize
from .network import Network

# Sizes that files of format 1 may lack: the network of such a file is without feelers.
_OPTIONAL = {"feelers", "feeler_radius", "feeler_samples"}


@dataclass(frozen=True)
class ImpactFormat(Network):
    """IMPACT of one size."""

    size: ImpactSize
    robot: Robot = PANDA

    @classmethod
    def format(cls) -> str:
        return "drpbench-impact-1"

    @classmethod
    def title(cls) -> str:
        return "IMPACT"

    def settings(self) -> dict[str, Any]:
        return asdict(self.size)

    @classmethod
    def from_settings(cls, settings: Mapping[str, Any], robot: Robot = PANDA) -> Network:
        names = {field.name for field in fields(ImpactSize)}
        if not names - _OPTIONAL <= settings.keys() <= names:
            raise ValueError(f"expected {', '.join(sorted(names))}")
        # JSON has no tuples, and lists cannot be hashed.
        values: dict[str, Any] = {
            name: tuple(value) if isinstance(value, list) else value
            for name, value in settings.items()
        }
        return cls(ImpactSize(**values), robot)

    def shapes(self) -> dict[str, Any]:
        return shapes(self.size, self.robot)

    def policy(self, parameters: Any, weights: str = "") -> Impact:
        return Impact(parameters, self.size, weights, self.robot)
