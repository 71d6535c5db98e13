"""Networks small enough to train in a test, and demonstrations that are there already."""

from dataclasses import dataclass

import jax
import jax.numpy as jnp

from drpbench.learning import Learner, chunk_loss
from drpbench.learning.cloning import CloningSettings
from drpbench.learning.learners.impact import ImpactLearner
from drpbench.learning.train import Run
from drpbench.policies import Hold
from drpbench.policies.networks.impact import ImpactSize


@dataclass(frozen=True)
class Mean(Learner):
    """Answers the same chunk everywhere, and sees nothing but chunks; compiled at once."""

    scale: float = 1.0

    def initial(self, seed):
        return {"chunk": jnp.full((10, 7), self.scale)}

    def sample(self, key, demonstrations, count):
        which_key, first_key = jax.random.split(key)
        paths, waypoints, _ = demonstrations.path.shape
        which = jax.random.randint(which_key, (count, 1), 0, paths)
        first = jax.random.randint(first_key, (count, 1), 0, waypoints - 10)
        way = demonstrations.path[which, first + jnp.arange(11)]
        return 10.0 * (way[:, 1:] - way[:, :1])

    def loss(self, parameters, batch, precision):
        return chunk_loss(batch, jnp.broadcast_to(parameters["chunk"], batch.shape))

    def policy(self, parameters, weights=""):
        return Hold()


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


LEARNER, MEAN = ImpactLearner(TINY), Mean()


class Fixed:
    """A feed of demonstrations that are there already."""

    about = "a handful"

    def __init__(self, demonstrations):
        self._demonstrations = demonstrations

    def begin(self):
        return self._demonstrations

    def refresh(self, resident):
        return resident


def run(out, learner=MEAN, steps=12, **changes):
    """A short run without validation."""
    given = {
        "settings": CloningSettings(steps=steps, batch=16, warmup=2),
        "report_every": 2,
        "checkpoint_every": 4,
        "validation_problems": 0,
    }
    return Run(out, learner, **(given | changes))
