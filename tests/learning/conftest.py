"""A handful of demonstrations that need no expert: the hints themselves."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from drpbench.geometry import stacked
from drpbench.learning.demonstrations import Demonstrations
from drpbench.robot import PANDA


@pytest.fixture(scope="session")
def demonstrations(drawn):
    free = [one for one in drawn if not one.obstructed]

    def stack(name):
        return np.stack([getattr(one, name) for one in free])

    steps = np.abs(np.diff(stack("hint"), axis=1)) / PANDA.velocity_limit
    arrays = Demonstrations(
        index=stack("index"),
        family=stack("family"),
        obstacles=stacked([one.obstacles for one in free]),
        goal=stack("goal"),
        path=stack("hint"),
        length=steps.max(axis=2).sum(axis=1).astype(np.float32),
        reached=np.ones(len(free), bool),
    )
    return jax.tree.map(jnp.asarray, arrays)
