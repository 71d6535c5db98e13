"""A network small enough to train in a test, and demonstrations that are there already."""

from drpbench.learning.cloning import CloningSettings
from drpbench.learning.learners.impact import ImpactLearner
from drpbench.learning.train import Run
from drpbench.policies.networks.impact import ImpactSize

TINY = ImpactSize(
    scene_points=64,
    scene_tokens=4,
    robot_points=16,
    robot_tokens=2,
    radius=0.2,
    samples=4,
    point_mlp=(8, 8),
    joint_mlp=(16,),
    width=16,
    feed_forward=16,
    heads=2,
    encoder_layers=1,
    decoder_layers=1,
)


LEARNER = ImpactLearner(TINY)


class Fixed:
    """A feed of demonstrations that are there already."""

    about = "a handful"

    def __init__(self, demonstrations):
        self._demonstrations = demonstrations

    def begin(self):
        return self._demonstrations

    def refresh(self, resident):
        return resident


def run(out, learner=LEARNER, steps=12, **changes):
    """A short run without validation."""
    given = {
        "settings": CloningSettings(steps=steps, batch=16, warmup=2),
        "report_every": 2,
        "checkpoint_every": 4,
        "validation_problems": 0,
    }
    return Run(out, learner, **(given | changes))
