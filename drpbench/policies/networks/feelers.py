"""Places on the arm from which a network feels what is around it."""

from functools import cache

import jax
import jax.numpy as jnp
import numpy as np

from drpbench.robot import PANDA, BodyPoints, Robot


def most_feelers(robot: Robot = PANDA) -> int:
    """How many there can be: the collision spheres from the forearm to the fingers."""
    return _feeling(robot).count


@cache
def feeler_points(count: int, robot: Robot = PANDA) -> BodyPoints:
    """`count` of the arm's sphere centres, spread over it: each the farthest from those before it,
    at home.

    Raises ValueError for more than `most_feelers`.
    """
    model = _feeling(robot)
    if not 0 <= count <= model.count:
        raise ValueError(f"feelers must be 0 to {model.count} on {robot.name}, got {count}")
    with jax.ensure_compile_time_eval():
        home = jnp.asarray(robot.home, jnp.float32)
        places = np.asarray(model.world(robot.link_poses(home)))
    chosen = [model.count - 1]
    while len(chosen) < count:
        gap = np.linalg.norm(places[:, None] - places[chosen], axis=-1).min(axis=1)
        chosen.append(int(np.argmax(gap)))
    return model.part(np.sort(chosen))


def _feeling(robot: Robot) -> BodyPoints:
    spheres = robot.moving_spheres
    return spheres.part(spheres.frame >= robot.forearm)
