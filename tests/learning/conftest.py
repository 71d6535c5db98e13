"""A handful of demonstrations that need no expert: the hints themselves."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.experimental.compilation_cache import compilation_cache

from drpbench.geometry import stacked
from drpbench.learning.demonstrations import Demonstrations
from drpbench.robot import PANDA


@pytest.fixture(scope="session", autouse=True)
def programs_are_compiled_once(tmp_path_factory):
    """Every training compiles its program anew; most of them are the same."""
    before = jax.config.jax_compilation_cache_dir
    jax.config.update("jax_compilation_cache_dir", str(tmp_path_factory.mktemp("programs")))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 1.0)
    compilation_cache.reset_cache()
    yield
    jax.config.update("jax_compilation_cache_dir", before)
    compilation_cache.reset_cache()


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
