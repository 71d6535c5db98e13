"""Problem sets as JSON lines: what is written is read back, and what is wrong is named with its
line."""

import json

import jax
import numpy as np
import pytest

from drpbench.envs import TASKS, World
from drpbench.planning.checker import sphere_checker
from drpbench.problems import ProblemSetError, export_lines, goal_poses, load_set
from drpbench.problems.lines import FORMAT
from drpbench.robot import PANDA, arm
from drpbench.rollout import instance_key

HEADER = {"format": FORMAT, "name": "mine", "tasks": ["SE"]}
HOME = PANDA.home.round(3).tolist()
BALL = {"shape": "sphere", "radius": 0.1, "position": [0.5, 0.0, 0.5]}
PROBLEM = {"task": "SE", "start": HOME, "goal": HOME, "obstacles": [BALL]}


def write(path, *lines):
    path.write_text("".join(f"{json.dumps(line)}\n" for line in lines))
    return path


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    path = tmp_path_factory.mktemp("sets") / "fdo.jsonl"
    path.write_text("".join(f"{line}\n" for line in export_lines(load_set(), ["FDO"])))
    return path


def arrays(problems):
    own = (problems.start, problems.goal, problems.goal_position, problems.goal_quaternion)
    return [*jax.tree.leaves(problems.obstacles), *own, problems.level, *problems.witness]


def test_an_exported_task_is_read_back_to_the_bit(exported):
    benchmark, found = load_set(), load_set(exported)
    assert found.name == "drpbench-v1-FDO" and found.tasks == ("FDO",)
    assert found.counts == {"FDO": benchmark.counts["FDO"]}
    assert found.robot is benchmark.robot and found.ground == benchmark.ground
    here, there = found.task("FDO"), benchmark.task("FDO")
    for a, b in zip(arrays(here), arrays(there), strict=True):
        assert a.dtype == b.dtype and np.array_equal(a, b)
    assert list(here.family) == list(there.family) and list(here.pair) == list(there.pair)


def test_what_is_read_is_exported_to_the_same_lines(exported):
    again = "".join(f"{line}\n" for line in export_lines(load_set(exported)))
    assert again == exported.read_text()


@pytest.mark.slow
def test_the_world_shows_the_same_first_observation(exported):
    world = World(TASKS["FDO"])

    @jax.jit
    def first(problem):
        return world.observe(world.reset(problem, instance_key(0, "FDO", problem.id, 0)))

    shown = [
        jax.vmap(first)(problem_set.task("FDO").take([0, 17]))
        for problem_set in (load_set(), load_set(exported))
    ]
    for a, b in zip(*map(jax.tree.leaves, shown), strict=True):
        assert np.array_equal(a, b)


def test_the_checksum_is_of_the_file(exported, tmp_path):
    other = tmp_path / "other.jsonl"
    other.write_text(exported.read_text().replace("drpbench-v1-FDO", "other"))
    assert load_set(other).sha256 != load_set(exported).sha256
    assert load_set(exported).sha256 == load_set(exported).sha256


def test_what_may_be_left_out_has_its_usual_value(tmp_path):
    found = load_set(write(tmp_path / "x.jsonl", HEADER, PROBLEM, PROBLEM | {"obstacles": []}))
    assert (found.name, found.arm, found.finger_opening, found.ground) == (
        *("mine", "panda", 0.04, True),
    )
    problems = found.task("SE")
    assert problems.level.tolist() == [0, 0] and list(problems.pair) == ["", ""]
    assert problems.witness[0].shape == (0, PANDA.joints)
    assert problems.obstacles.mask.tolist() == [[True], [False]]
    assert problems.obstacles.quaternion[0, 0].tolist() == [1, 0, 0, 0]


def test_the_goal_pose_follows_from_the_joints(tmp_path, spheres):
    goal = (PANDA.home + 0.2).round(3).tolist()
    given = {"goal_position": [0.4, 0.1, 0.5], "goal_quaternion": [0.0, 1.0, 0.0, 0.0]}
    path = write(
        tmp_path / "x.jsonl", HEADER, PROBLEM | {"goal": goal}, PROBLEM | {"goal": goal} | given
    )
    problems = load_set(path).task("SE")
    position, rotation = spheres.grip_pose(np.array(goal))
    np.testing.assert_allclose(problems.goal_position[0], position, atol=1e-6)
    w, x, y, z = problems.goal_quaternion[0]
    np.testing.assert_allclose(2 * (x * z + w * y), rotation[0, 2], atol=1e-5)
    np.testing.assert_array_equal(problems.goal_position[1], np.float32(given["goal_position"]))
    np.testing.assert_array_equal(problems.goal_quaternion[1], given["goal_quaternion"])


def test_the_header_says_which_arm_and_what_it_stands_on(tmp_path):
    header = HEADER | {"finger_opening": 0.01, "ground": False}
    found = load_set(write(tmp_path / "x.jsonl", header, PROBLEM))
    assert found.robot == arm("panda", 0.01) != PANDA and not found.ground


def test_tasks_come_in_the_header_s_order_whatever_the_lines_order(tmp_path):
    header = HEADER | {"tasks": ["GB", "SE"]}
    path = write(tmp_path / "x.jsonl", header, PROBLEM, PROBLEM | {"task": "GB"}, PROBLEM)
    assert load_set(path).counts == {"GB": 1, "SE": 2}


BEYOND = [*HOME[:3], -4.0, *HOME[4:]]


@pytest.mark.parametrize(
    ("header", "problem", "line", "told"),
    [
        ([], {}, 1, "expected a JSON object, got list"),
        ({"name": "mine"}, {}, 1, 'expected the header, with "format"'),
        (HEADER | {"name": " "}, {}, 1, "name: expected the set's name"),
        (HEADER | {"arm": "ur5"}, {}, 1, "no arm 'ur5'; the arms are: panda"),
        (HEADER | {"finger_opening": "wide"}, {}, 1, "finger_opening: expected metres"),
        (HEADER | {"ground": 1}, {}, 1, "ground: expected true or false"),
        (HEADER | {"tasks": []}, {}, 1, "tasks: expected a list"),
        (HEADER | {"tasks": ["SE", "SE"]}, {}, 1, "a task is named twice"),
        (HEADER | {"author": "me"}, {}, 1, "the header has no field 'author'"),
        (HEADER | {"tasks": ["SE", "GB"]}, {}, 2, "ends without a problem of task GB"),
        (HEADER, {"task": "GB"}, 2, r"task: expected one of the header's \(SE\), got 'GB'"),
        (HEADER, {"id": 1}, 2, "id: expected 0, the next of SE, got 1"),
        (HEADER, {"goals": HOME}, 2, "a problem has no field 'goals'"),
        (HEADER, {"start": HOME[:6]}, 2, "start: expected 7 finite numbers, got a wrong value"),
        (HEADER, {"start": None}, 2, "start: expected 7 finite numbers"),
        (HEADER, {"goal": [*HOME[:6], float("nan")]}, 2, "goal: expected 7 finite numbers"),
        (HEADER, {"goal": BEYOND}, 2, "goal: joint 4 is -4 rad, beyond its limits"),
        (HEADER, {"goal_position": [0, 0, 1]}, 2, "goal_position and goal_quaternion together"),
        (HEADER, {"level": 1.5}, 2, "level: expected a whole number"),
        (HEADER, {"family": ""}, 2, "family: expected a word"),
        (HEADER, {"witness": [HOME, HOME[:6]]}, 2, "witness: expected 2 x 7 finite numbers"),
        (HEADER, {"obstacles": {}}, 2, "obstacles: expected a list"),
        (HEADER, {"obstacles": [BALL, {"shape": "mesh"}]}, 2, "obstacle 1: expected a shape"),
        (HEADER, {"obstacles": [BALL | {"radius": 0}]}, 2, "obstacle 0: .*must be above 0"),
        (HEADER, {"obstacles": [BALL | {"size": [1, 1, 1]}]}, 2, "a sphere has no field 'size'"),
        (
            HEADER,
            {"obstacles": [BALL | {"quaternion": [1, 1, 0, 0]}]},
            2,
            "quaternion: expected a unit quaternion",
        ),
    ],
)
def test_what_is_wrong_is_one_line_with_its_number(tmp_path, header, problem, line, told):
    path = write(tmp_path / "x.jsonl", header, PROBLEM | problem)
    with pytest.raises(ProblemSetError, match=rf"x\.jsonl: line {line}: .*{told}") as error:
        load_set(path)
    assert "\n" not in str(error.value)


def test_a_line_that_is_cut_is_named(exported, tmp_path):
    text = exported.read_text().splitlines()
    cut = tmp_path / "cut.jsonl"
    cut.write_text("\n".join([*text[:5], text[5][:50]]))
    with pytest.raises(ProblemSetError, match="line 6: expected one JSON object"):
        load_set(cut)
    cut.write_bytes(b"\xff\xfe")
    with pytest.raises(ProblemSetError, match="cannot be read as text"):
        load_set(cut)
    cut.write_text("")
    with pytest.raises(ProblemSetError, match="line 1: expected one JSON object"):
        load_set(cut)


def test_a_goal_may_be_a_pose_alone(tmp_path):
    whole = load_set(write(tmp_path / "a.jsonl", HEADER, PROBLEM | {"goal": [0.9, *HOME[1:]]}))
    pose = {
        "goal_position": whole.task("SE").goal_position[0].tolist(),
        "goal_quaternion": whole.task("SE").goal_quaternion[0].tolist(),
    }
    given = {name: value for name, value in PROBLEM.items() if name != "goal"}
    found = load_set(write(tmp_path / "b.jsonl", HEADER, given | pose)).task("SE")
    np.testing.assert_array_equal(found.goal_position, whole.task("SE").goal_position)
    position, quaternion = goal_poses(PANDA, found.goal)
    np.testing.assert_allclose(position, found.goal_position, atol=2e-3)
    assert np.abs(quaternion[0] @ found.goal_quaternion[0]) > 0.999
    checker = sphere_checker()
    checker.set_obstacles(found.obstacles[0])
    assert checker.free(found.goal[0].astype(float))
    again = load_set(tmp_path / "b.jsonl").task("SE")
    np.testing.assert_array_equal(again.goal, found.goal)
    on_it = given | pose | {"obstacles": [BALL | {"position": pose["goal_position"]}]}
    with pytest.raises(ProblemSetError, match="line 2: no joints that touch nothing"):
        load_set(write(tmp_path / "c.jsonl", HEADER, on_it))
    with pytest.raises(ProblemSetError, match="line 2: goal: expected 7 finite numbers"):
        load_set(write(tmp_path / "d.jsonl", HEADER, given))
