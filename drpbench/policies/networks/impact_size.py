"""The sizes of IMPACT: what a file of weights states, and the two that there are by name."""

from dataclasses import dataclass, fields

from drpbench.contract import ROBOT_POINTS, SCENE_POINTS


@dataclass(frozen=True)
class ImpactSize:
    """Every size of the network; the defaults are the paper's."""

    scene_points: int = 2048
    """Of the 2048 observed points every (2048 / scene_points)-th is used."""
    scene_tokens: int = 128
    robot_points: int = 256
    robot_tokens: int = 16
    radius: float = 0.1
    """[m] of the ball query."""
    samples: int = 64
    point_mlp: tuple[int, ...] = (64, 64, 64)
    joint_mlp: tuple[int, ...] = (128, 256)
    width: int = 128
    feed_forward: int = 1024
    heads: int = 8
    encoder_layers: int = 6
    decoder_layers: int = 6
    sees_goal: bool = False
    """Whether the arm at its goal is shown: as tokens, and every scene point with its closeness to
    the arm as it is and as it will be. The paper's network has to find that out from joints alone,
    which takes data by the million."""
    feelers: int = 0
    """So many places on the arm feel what is around them: for each, the scene points within
    `feeler_radius` make a token, with the arm as it is and again with the arm at its goal."""
    feeler_radius: float = 0.12
    """[m]"""
    feeler_samples: int = 24

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if (
                not isinstance(value, bool)
                and field.name != "feelers"
                and min(value if isinstance(value, tuple) else (value,)) <= 0
            ):
                raise ValueError(f"{field.name} must be positive, not {value}")
        if self.feelers < 0:
            raise ValueError(f"feelers must be 0 or more, not {self.feelers}")
        for used, all_of_them in (("scene_points", SCENE_POINTS), ("robot_points", ROBOT_POINTS)):
            if all_of_them % getattr(self, used):
                raise ValueError(f"{used} must divide {all_of_them}, not be {getattr(self, used)}")
        if self.width % self.heads:
            raise ValueError(f"width {self.width} is not a multiple of heads {self.heads}")

    @property
    def points_seen(self) -> int:
        """How many scene points are looked at: feelers miss none of them."""
        return SCENE_POINTS if self.feelers else self.scene_points


FULL = ImpactSize()
SMALL = ImpactSize(
    scene_points=512,
    scene_tokens=48,
    robot_points=64,
    robot_tokens=8,
    radius=0.2,
    samples=16,
    point_mlp=(32, 64),
    joint_mlp=(64, 128),
    width=64,
    feed_forward=256,
    heads=4,
    encoder_layers=2,
    decoder_layers=1,
    sees_goal=True,
    feelers=12,
)
"""For processors without an accelerator: the same architecture, but that it sees the arm at its
goal, and has feelers."""
SIZES = {"full": FULL, "small": SMALL}
