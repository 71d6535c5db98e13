"""The LSTM with a Gaussian mixture as a file of weights knows it."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

from drpbench.robot import PANDA, Robot

from .lstm_gmm import shapes
from .lstm_gmm_policy import LstmGmm
from .lstm_gmm_size import LstmGmmSize
from .network import Network


@dataclass(frozen=True)
class LstmGmmFormat(Network):
    """NeuralMP's architecture, of one size."""

    size: LstmGmmSize
    robot: Robot = PANDA

    @classmethod
    def format(cls) -> str:
        return "drpbench-lstm-gmm-1"

    @classmethod
    def title(cls) -> str:
        return "LSTM with a Gaussian mixture (NeuralMP)"

    def settings(self) -> dict[str, Any]:
        return asdict(self.size)

    @classmethod
    def from_settings(cls, settings: Mapping[str, Any], robot: Robot = PANDA) -> Network:
        names = set(asdict(LstmGmmSize()))
        if settings.keys() != names:
            raise ValueError(f"expected {', '.join(sorted(names))}")
        # JSON has no tuples, and lists cannot be hashed.
        values: dict[str, Any] = {
            name: tuple(value) if isinstance(value, list) else value
            for name, value in settings.items()
        }
        return cls(LstmGmmSize(**values), robot)

    def shapes(self) -> dict[str, Any]:
        return shapes(self.size, self.robot)

    def policy(self, parameters: Any, weights: str = "") -> LstmGmm:
        return LstmGmm(parameters, self.size, weights, self.robot)
