"""Golden first observations: an instance must begin the same way in every version to come.

`python tests/evaluation/test_first_observations.py` writes the golden file anew, which changes what
every published score means: only with a new problem set or protocol version.
"""

import hashlib
import json
from pathlib import Path

import jax
import numpy as np
import pytest

from drpbench.compile import jit
from drpbench.envs import TASKS, World
from drpbench.problems import load_set
from drpbench.rollout import instance_key

pytestmark = pytest.mark.slow

GOLDEN = Path(__file__).parent / "first_observations.json"
IDS = [0, 1, 5]


def digest(task: str) -> dict:
    """Random keys as a hash, exact; what is computed in floating point as sums, to be compared
    closely."""
    problems = load_set().task(task).take(IDS)
    world = World(TASKS[task])

    def begin(problem):
        key = instance_key(0, task, problem.id, 0)
        state = world.reset(problem, key)
        return jax.random.key_data(key), state.movers, world.observe(state)

    keys, movers, seen = jit(jax.vmap(begin))(problems)
    mask, points = np.asarray(seen.scene_mask), np.asarray(seen.scene_points, float)

    def plain(array, digits=7):
        return np.asarray(array, float).round(digits).tolist()

    return {
        "keys": hashlib.sha256(np.asarray(keys, "<u4").tobytes()).hexdigest(),
        "points_seen": mask.sum(axis=1).tolist(),
        "mean_point": plain(points.mean(axis=1)),
        "point_spread": plain(points.std(axis=(1, 2))),
        "robot": plain(np.mean(seen.robot_points, axis=1)),
        "goal": plain(seen.goal_position),
        "boxes": plain(movers.position),
        "box_sizes": plain(movers.half_size),
        "box_speeds": plain(np.linalg.norm(movers.velocity, axis=-1), 9),
    }


@pytest.mark.parametrize("task", TASKS)
def test_episodes_begin_as_they_always_did(task):
    golden, now = json.loads(GOLDEN.read_text())[task], digest(task)
    assert now["keys"] == golden["keys"]
    # A point at the very edge of z = 0 may fall either way on another processor.
    assert np.abs(np.subtract(now["points_seen"], golden["points_seen"])).max() <= 2
    for name in set(golden) - {"keys", "points_seen"}:
        np.testing.assert_allclose(now[name], golden[name], atol=2e-3 if "point" in name else 1e-5)


if __name__ == "__main__":
    GOLDEN.write_text(json.dumps({task: digest(task) for task in TASKS}, indent=1) + "\n")
