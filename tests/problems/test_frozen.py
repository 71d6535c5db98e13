"""The shipped problem set: complete, undamaged, certified, and what its export says."""

import json
import shutil
import subprocess
import sys

import numpy as np
import pytest

from drpbench.generation import certificate
from drpbench.generation.composition import COMPOSITION, group_of
from drpbench.geometry import quaternion_to_matrix
from drpbench.problems import (
    PROBLEM_SET,
    ProblemSetError,
    frozen,
    load_set,
    matching,
    to_json,
)
from drpbench.robot import PANDA

COUNTS = {"SE": 3200, "SAO": 300, "FDO": 200, "GB": 200, "DGB": 400}
TASKS = tuple(COUNTS)


def test_counts_are_the_benchmarks():
    benchmark = load_set()
    assert benchmark.name == PROBLEM_SET and len(benchmark.sha256) == 64
    assert benchmark.counts == COUNTS and benchmark.tasks == TASKS == tuple(COMPOSITION)
    for task in TASKS:
        problems = benchmark.task(task)
        assert problems.count == COUNTS[task] == len(problems.witness) == len(problems.start)
        named = list(zip(problems.family, problems.pair, problems.level.tolist(), strict=True))
        assert named[:32] == [
            (g.family, g.pair, g.level) for g in (group_of(task, i) for i in range(32))
        ]
        for group in COMPOSITION[task]:
            assert named.count((group.family, group.pair, group.level)) == group.count


@pytest.mark.parametrize("task", TASKS)
def test_arrays_are_padded_and_finite(task):
    problems = load_set().task(task)
    obstacles = problems.obstacles
    n, width = obstacles.mask.shape
    assert width <= 24
    for name, tail in (("half_size", 3), ("position", 3), ("quaternion", 4)):
        array = getattr(obstacles, name)
        assert array.shape == (n, width, tail) and array.dtype == np.float32
        assert np.all(np.isfinite(array))
    assert obstacles.kind.dtype == np.int32 and set(np.unique(obstacles.kind)) <= {0, 1, 2}
    assert np.all(obstacles.half_size > 0)
    np.testing.assert_allclose(np.linalg.norm(obstacles.quaternion, axis=-1), 1, atol=1e-6)
    assert np.all(obstacles.mask[:, 0]), "the table comes first"
    top = obstacles.position[:, 0, 2] + obstacles.half_size[:, 0, 2]
    assert np.all(top == 0.0)


@pytest.mark.parametrize("task", TASKS)
def test_goals_are_poses_and_standing_still_is_no_solution(task, spheres):
    problems = load_set().task(task)
    for index in range(0, problems.count, max(1, problems.count // 200)):
        position, matrix = spheres.grip_pose(problems.goal[index].astype(float))
        np.testing.assert_allclose(problems.goal_position[index], position, atol=1e-6)
        turned = quaternion_to_matrix(problems.goal_quaternion[index].astype(float))
        np.testing.assert_allclose(turned, matrix, atol=1e-5)
        here, _ = spheres.grip_pose(problems.start[index].astype(float))
        distance = np.linalg.norm(here - position)
        if task == "DGB":
            assert np.array_equal(problems.start[index], problems.goal[index])
        else:
            assert distance >= max(0.2, group_of(task, index).distance) - 1e-6


@pytest.mark.parametrize("task", TASKS)
def test_witnesses_of_a_sample_hold_by_spheres_and_by_meshes(task, spheres, meshes):
    problems = load_set().task(task)
    for index in np.random.default_rng(11).choice(problems.count, 40, replace=False):
        for checker in (spheres, meshes):
            checker.set_obstacles(problems.obstacles[index])
        proof = certificate.certify(
            problems.witness[index],
            problems.start[index].astype(float),
            problems.goal[index].astype(float),
            spheres,
            meshes,
        )
        assert proof.fault is None, f"{task} {index}: {proof.fault}"
        assert proof.mesh_clearance > 0


def test_the_straight_line_fails_most_static_problems_but_not_all(spheres):
    from drpbench.planning.rrt_connect import Planner

    problems, free = load_set().task("SE"), []
    for index in range(160):
        spheres.set_obstacles(problems.obstacles[index])
        ends = problems.start[index].astype(float), problems.goal[index].astype(float)
        free.append(Planner(spheres, 0.0).straight(*ends))
    assert 0.05 < np.mean(free) < 0.35


@pytest.mark.parametrize("task", TASKS)
def test_the_export_reads_back_to_the_same_problem(task):
    problems = load_set().task(task)
    for index in (0, 7, problems.count - 1):
        entry = json.loads(json.dumps(to_json(problems, index)))
        assert list(entry) == [
            *("id", "task", "family", "pair", "level", "start", "goal"),
            *("goal_position", "goal_quaternion", "obstacles", "witness"),
        ]
        assert (entry["id"], entry["task"]) == (index, task)
        assert np.array_equal(np.float32(entry["start"]), problems.start[index])
        assert np.array_equal(np.float32(entry["goal"]), problems.goal[index])
        assert np.array_equal(np.float32(entry["witness"]), problems.witness[index])
        there = problems.obstacles[index].present()
        kinds, halves = there.kind, there.half_size
        positions, quaternions = there.position, there.quaternion
        assert len(entry["obstacles"]) == len(kinds)
        for i, obstacle in enumerate(entry["obstacles"]):
            assert obstacle["shape"] == ("box", "cylinder", "sphere")[kinds[i]]
            if obstacle["shape"] == "box":
                half = np.float32(obstacle["size"]) / 2
            elif obstacle["shape"] == "cylinder":
                radius = np.float32(obstacle["radius"])
                half = np.array([radius, radius, np.float32(obstacle["height"]) / 2])
            else:
                half = np.full(3, np.float32(obstacle["radius"]))
            assert np.array_equal(half, halves[i])
            assert np.array_equal(np.float32(obstacle["position"]), positions[i])
            assert np.array_equal(np.float32(obstacle["quaternion"]), quaternions[i])


def test_a_number_beyond_the_set_is_named():
    with pytest.raises(ProblemSetError, match="no problem 200 in FDO; ids go from 0 to 199"):
        to_json(load_set().task("FDO"), 200)


def test_unknown_tasks_and_sets_list_what_there_is():
    with pytest.raises(
        ProblemSetError, match="no task 'XYZ' in drpbench-v1; its tasks are SE, SAO, FDO, GB, DGB"
    ):
        load_set().task("XYZ")
    installed = r"\(drpbench-v1, mpinets-like-v1\)"
    with pytest.raises(ProblemSetError, match=rf"no problem set 'v9', .*{installed}"):
        load_set("v9")


def test_the_set_is_for_the_panda_on_a_table():
    benchmark = load_set()
    assert benchmark.robot is PANDA and benchmark.ground


def test_a_set_is_found_by_name_and_checksum_and_no_other_one_is():
    benchmark = load_set()
    assert matching(benchmark.name, benchmark.sha256) is benchmark
    with pytest.raises(ProblemSetError, match="mine does not come .* --problems-from"):
        matching("mine", benchmark.sha256)
    for given in (None, benchmark):
        with pytest.raises(ProblemSetError, match="checksum 000000000000.*; the problems here are"):
            matching(benchmark.name, "0" * 64, given)


def test_damaged_data_are_refused_in_one_line(tmp_path):
    for ending in ("npz", "json"):
        shutil.copy(frozen.DATA / f"{PROBLEM_SET}.{ending}", tmp_path)
    assert load_set(folder=tmp_path).counts == COUNTS
    content = bytearray((tmp_path / f"{PROBLEM_SET}.npz").read_bytes())
    content[len(content) // 2] ^= 1
    damaged = tmp_path / "damaged"
    damaged.mkdir()
    (damaged / f"{PROBLEM_SET}.npz").write_bytes(content)
    shutil.copy(tmp_path / f"{PROBLEM_SET}.json", damaged)
    with pytest.raises(ProblemSetError, match="is damaged: its checksum is") as error:
        load_set(folder=damaged)
    assert "\n" not in str(error.value)
    (damaged / f"{PROBLEM_SET}.json").write_text('{"tasks": ')
    with pytest.raises(ProblemSetError, match="not the manifest"):
        load_set(folder=damaged)


def test_the_data_are_small():
    assert (frozen.DATA / f"{PROBLEM_SET}.npz").stat().st_size < 6e6


def test_loading_a_set_starts_no_simulator_and_no_device():
    code = (
        "import sys, drpbench.problems as p; p.load_set();"
        "from jax._src import xla_bridge;"
        "print([m for m in ('mujoco', 'mink') if m in sys.modules], "
        "xla_bridge.backends_are_initialized())"
    )
    shown = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert shown.stdout.strip() == "[] False"
