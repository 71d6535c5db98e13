"""Recorded episodes: whole, in their own steps, and refused when damaged."""

import numpy as np
import pytest

from drpbench.envs import TASKS, World
from drpbench.results import ResultsError
from drpbench.results.trajectories import Trajectories, load_trajectories
from drpbench.rollout import Trace

STEPS, MOVERS = 5, 2


def trace(count: int, seed: int) -> Trace:
    """Random numbers in the shapes of `count` episodes."""
    rng = np.random.default_rng(seed)
    steps = {
        "joint_position": (7,),
        "joint_velocity": (7,),
        "grip_position": (3,),
        "position_error": (),
        "orientation_error": (),
        "clearance": (),
        "sphere": (),
        "self_clearance": (),
        "finite": (),
        "mover_position": (MOVERS, 3),
        "mover_active": (MOVERS,),
        "mover_half_size": (MOVERS, 3),
        "mover_rotation": (MOVERS, 3, 3),
    }
    once = {"start": (7,), "start_grip": (3,), "valid": ()}
    return Trace(
        world=World(TASKS["FDO"]),
        **{name: rng.random((STEPS, count, *shape), np.float32) for name, shape in steps.items()},
        **{name: rng.random((count, *shape), np.float32) for name, shape in once.items()},
        failures=("",) * count,
    )


@pytest.mark.parametrize("name", ["run.json", "run.json.gz"])
def test_batches_become_one_file_with_each_instance_in_its_own_steps(tmp_path, name):
    first, second = trace(2, 0), trace(1, 1)
    trajectories = Trajectories(tmp_path / name)
    trajectories.add("FDO", [3, 9], first)
    trajectories.add("GB", [3], second)
    trajectories.finish()

    found = load_trajectories(tmp_path / "run.npz")
    assert sorted(found) == ["FDO-3", "FDO-9", "GB-3"]
    for episode, source, place in (("FDO-9", first, 1), ("GB-3", second, 0)):
        joints = found[episode]["joint_position"]
        np.testing.assert_array_equal(joints[0], source.start[place])
        np.testing.assert_array_equal(joints[1:], source.joint_position[:, place])
        for field in (
            "joint_velocity",
            "mover_position",
            "mover_active",
            "mover_half_size",
            "mover_rotation",
        ):
            np.testing.assert_array_equal(found[episode][field], getattr(source, field)[:, place])
    assert [path.name for path in tmp_path.iterdir()] == ["run.npz"]


@pytest.mark.parametrize("damage", ["cut", "garbled", "text", "array", "absent"])
def test_a_damaged_file_is_refused_in_one_line(tmp_path, damage):
    trajectories = Trajectories(tmp_path / "run.json")
    trajectories.add("FDO", [0], trace(1, 0))
    trajectories.finish()
    path = tmp_path / "run.npz"
    whole = path.read_bytes()
    middle = len(whole) // 2
    if damage == "cut":
        path.write_bytes(whole[:middle])
    elif damage == "garbled":
        path.write_bytes(whole[:100] + bytes(200) + whole[300:])
    elif damage == "text":
        path.write_text("not an archive")
    elif damage == "absent":
        path.unlink()
    elif damage == "array":
        with open(path, "wb") as file:
            np.save(file, np.zeros(3))
    with pytest.raises(ResultsError, match="run.npz: not a readable trajectory file") as error:
        load_trajectories(path)["FDO-0"]
    assert len(str(error.value).splitlines()) == 1
