"""The sizes of the LSTM with a Gaussian mixture: what a file of weights states, and the two that
there are by name."""

from dataclasses import dataclass, fields

from drpbench.contract import ROBOT_POINTS, SCENE_POINTS


@dataclass(frozen=True)
class LstmGmmSize:
    """Every size of the network; the defaults are NeuralMP's, as its released configuration has
    them, with the clouds that are observed here (2048 points of the scene instead of 4096, 256 of
    the arm instead of 2048)."""

    scene_points: int = 2048
    """Of the 2048 observed points every (2048 / scene_points)-th is used."""
    arm_points: int = 256
    """As many show the arm as it is, and again the arm at its goal."""
    first_tokens: int = 128
    first_radius: float = 0.05
    """[m] of the first set abstraction's ball query."""
    first_samples: int = 64
    first_mlp: tuple[int, ...] = (64, 64, 64)
    second_tokens: int = 64
    second_radius: float = 0.3
    """[m]"""
    second_samples: int = 64
    second_mlp: tuple[int, ...] = (128, 128, 256)
    whole_mlp: tuple[int, ...] = (512, 512)
    """Of the third set abstraction, whose one ball is the whole cloud."""
    scene_mlp: tuple[int, ...] = (2048, 1024, 1024)
    """From the cloud's one token to what the LSTM sees of it."""
    lstm_layers: int = 2
    lstm_width: int = 1024
    horizon: int = 2
    """Control steps after which the LSTM begins anew, in training and in use."""
    modes: int = 5
    least_scale: float = 1e-4
    """Of a mode's standard deviation, in units of the action."""

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if min(value if isinstance(value, tuple) else (value,), default=0) <= 0:
                raise ValueError(f"{field.name} must be positive, not {value}")
        for used, all_of_them in (("scene_points", SCENE_POINTS), ("arm_points", ROBOT_POINTS)):
            if all_of_them % getattr(self, used):
                raise ValueError(f"{used} must divide {all_of_them}, not be {getattr(self, used)}")


FULL = LstmGmmSize()
SMALL = LstmGmmSize(
    scene_points=512,
    arm_points=64,
    first_tokens=64,
    first_radius=0.12,
    first_samples=16,
    first_mlp=(32, 64),
    second_tokens=24,
    second_radius=0.4,
    second_samples=16,
    second_mlp=(64, 128),
    whole_mlp=(128, 256),
    scene_mlp=(256, 256),
    lstm_width=256,
)
"""For processors: a sample costs what one of IMPACT's small size does."""
SIZES = {"full": FULL, "small": SMALL}
