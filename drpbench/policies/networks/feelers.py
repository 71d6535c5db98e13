"""Places on the arm from which a network feels what is around it."""

from functools import cache

import jax
import jax.numpy as jnp
import numpy as np

from drpbench.robot import PANDA, BodyPoints

# The collision spheres that may have feelers: those of the forearm to the fingers.
_MODEL = PANDA.moving_spheres.part(PANDA.moving_spheres.frame >= 3)
MOST_FEELERS = _MODEL.count


@cache
def feeler_points(count: int) -> BodyPoints:
    """`count` of the arm's sphere centres, spread over it: each the farthest from those before it, at home."""
    with jax.ensure_compile_time_eval():
        places = np.asarray(_MODEL.world(PANDA.link_poses(jnp.asarray(PANDA.home, jnp.float32))))
    chosen = [_MODEL.count - 1]
    while len(chosen) < count:
        gap = np.linalg.norm(places[:, None] - places[chosen], axis=-1).min(axis=1)
        chosen.append(int(np.argmax(gap)))
    return _MODEL.part(np.sort(chosen))
