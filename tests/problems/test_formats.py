"""Problems of other projects become a set of one's own, or are refused in one line."""

import json
from copy import deepcopy

import numpy as np
import pytest
import yaml
from typer.testing import CliRunner

from drpbench.cli.app import app
from drpbench.geometry.host_rotation import axis_angle, multiply
from drpbench.problems import load_set
from drpbench.problems.formats import FormatError, import_problems
from drpbench.robot import PANDA

JOINTS = [f"panda_joint{number}" for number in range(1, 8)]
FINGERS = ["panda_finger_joint1", "panda_finger_joint2"]
START = [float(q) for q in PANDA.home]
GOAL = [0.8, *START[1:]]
UPRIGHT = {"position": [0.0, 0.0, 0.0], "orientation": [0.0, 0.0, 0.0, 1.0]}
TURN = axis_angle([0.0, 0.0, 1.0], np.pi / 2)  # wxyz


def pose(position, wxyz):
    w, x, y, z = map(float, wxyz)
    return {"position": position, "orientation": [x, y, z, w]}


REQUEST = {
    "goal_constraints": [
        {
            # In another order than the arm's.
            "joint_constraints": [
                {"position": q, "joint_name": name}
                for name, q in reversed(list(zip(JOINTS, GOAL, strict=True)))
            ]
        }
    ],
    "start_state": {
        "joint_state": {"name": [*FINGERS, *JOINTS], "position": [0.065, 0.065, *START]}
    },
}
SCENE = {
    "world": {
        "collision_objects": [
            {
                "id": "Can1",
                "primitives": [{"type": "cylinder", "dimensions": [0.14, 0.03]}],
                "primitive_poses": [pose([0.5, 0.4, 0.2], [1, 0, 0, 0])],
            },
            {
                "id": "shelf",
                "pose": pose([1.0, 0.0, 0.5], TURN),
                "primitives": [
                    {"type": "box", "dimensions": [0.2, 0.4, 0.6]},
                    {"type": "sphere", "dimensions": [0.1]},
                ],
                "primitive_poses": [
                    pose([0.1, 0.0, 0.0], axis_angle([1.0, 0.0, 0.0], 0.3)),
                    pose([0.0, 0.0, 0.3], [1, 0, 0, 0]),
                ],
            },
        ]
    }
}
ROBOMETRICS = {
    "box_panda": [
        {
            "collision_buffer_ik": 0.0,
            "start": START,
            # The nearest is in the box, the second nearest is free.
            "goal_ik": [[2.0, *START[1:]], [0.3, *START[1:]], [1.2, *START[1:]]],
            "obstacles": {
                "cuboid": {
                    "box": {"dims": [0.06, 0.06, 0.06], "pose": [0.293, 0.09, 0.49, 1, 0, 0, 0]}
                },
                "cylinder": {
                    "can": {"radius": 0.03, "height": 0.2, "pose": [-0.6, 0, 0.1, 1, 0, 0, 0]}
                },
            },
            "world_frame": "panda_link0",
        },
    ]
}


def moveit(folder, request=REQUEST, scene=SCENE, name="box_panda"):
    """A folder as MotionBenchMaker's."""
    (folder / name).mkdir(parents=True, exist_ok=True)
    for kind, values in (("request", request), ("scene", scene)):
        (folder / name / f"{kind}0001.yaml").write_text(yaml.safe_dump(values))
    return folder


def robometrics(folder, families=ROBOMETRICS):
    path = folder / "set.yaml"
    path.write_text(yaml.safe_dump(families))
    return path


def run(*arguments):
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


def test_moveits_scenes_and_requests_become_a_set(tmp_path):
    out = tmp_path / "mine.jsonl"
    done = run("problems", "import", moveit(tmp_path / "mbm"), "--out", out)
    assert done.exit_code == 0, done.output
    assert "1 problems (box 1)" in done.output
    found = load_set(out)
    assert (found.name, found.finger_opening, found.ground) == ("moveit-mbm", 0.065, False)
    problems = found.task("SE")
    np.testing.assert_allclose(problems.start[0], START, rtol=1e-6)
    np.testing.assert_allclose(problems.goal[0], GOAL, rtol=1e-6)
    there = problems.obstacles[0].present()
    assert there.kind.tolist() == [1, 0, 2]
    np.testing.assert_allclose(there.half_size, [[0.03, 0.03, 0.07], [0.1, 0.2, 0.3], [0.1] * 3])
    # The object's own pose turns and moves its primitives.
    np.testing.assert_allclose(
        there.position, [[0.5, 0.4, 0.2], [1.0, 0.1, 0.5], [1.0, 0.0, 0.8]], atol=1e-6
    )
    np.testing.assert_allclose(
        there.quaternion[1], multiply(TURN, axis_angle([1.0, 0.0, 0.0], 0.3)), atol=1e-6
    )


def test_of_several_goals_the_free_one_nearest_to_the_start_is_kept(tmp_path):
    found = import_problems(robometrics(tmp_path))
    header, line = map(json.loads, found.lines)
    assert header["finger_opening"] == 0.025 and header["name"] == "set"
    assert found.families == {"box": 1} and found.touching == 0
    assert line["goal"][0] == 1.2
    assert [one["shape"] for one in line["obstacles"]] == ["box", "cylinder"]
    families = deepcopy(ROBOMETRICS)
    families["box_panda"][0]["goal_ik"] = families["box_panda"][0]["goal_ik"][1:2]
    assert import_problems(robometrics(tmp_path, families)).touching == 1


def test_what_is_left_out_is_counted(tmp_path):
    families = deepcopy(ROBOMETRICS)
    (one,) = families["box_panda"]
    families["dresser"] = [{**one, "collision_buffer_ik": -0.01}, {**one, "start": [9.0] * 7}]
    found = import_problems(robometrics(tmp_path, families))
    assert found.left_out == {"infeasible by their own set": 1, "beyond the joint limits": 1}
    assert found.families.total() == len(found.lines) - 1 == 1


def test_a_set_is_checked_and_the_valid_ones_are_written_with_their_ways(tmp_path):
    def line(goal, *obstacles):
        return {"task": "SE", "start": START, "goal": goal, "obstacles": list(obstacles)}

    taken = {"shape": "box", "size": [0.2, 0.2, 0.2], "position": [0.35, 0.36, 0.6]}
    post = {"shape": "cylinder", "radius": 0.02, "height": 0.5, "position": [0.5, 0.22, 0.25]}
    header = {"format": "drpbench-problems-1", "name": "mine", "tasks": ["SE"]}
    lines = [header, line(GOAL), line(GOAL, taken), line(GOAL, post)]
    path, out = tmp_path / "mine.jsonl", tmp_path / "valid.jsonl"
    path.write_text("".join(f"{json.dumps(one)}\n" for one in lines))
    done = run("problems", "check", path, "--out", out)
    assert done.exit_code == 1
    assert "SE 1 (any): the goal touches something" in done.output
    assert "SE: 2 of 3 are valid" in done.output
    valid = load_set(out).task("SE")
    assert valid.count == 2 and len(valid.witness[0]) == 2 <= len(valid.witness[1])
    again = run("problems", "check", out)
    assert again.exit_code == 0 and "SE: 2 of 2 are valid" in again.output
    assert run("problems", "check", path, "--out", out).exit_code != 0  # it is there


def changed(values, *path):
    """A copy in which the value at a path of keys is another: the path's last."""
    copy = deepcopy(values)
    inner = copy
    for key in path[:-2]:
        inner = inner[key]
    inner[path[-2]] = path[-1]
    return copy


OBJECTS = ("world", "collision_objects")


@pytest.mark.parametrize(
    ("request_", "scene", "said"),
    [
        (REQUEST | {"goal_constraints": []}, SCENE, "expected one goal of joint_constraints"),
        ({}, SCENE, "there is no start_state"),
        ([1, 2], SCENE, "expected fields, among them start_state"),
        (
            changed(REQUEST, "start_state", "joint_state", "name", ["ur5_joint"] * 9),
            SCENE,
            "expected an arm called panda.*there is no panda_joint1",
        ),
        (
            changed(REQUEST, "start_state", "joint_state", "position", [float("nan")] * 9),
            SCENE,
            "expected 9 finite numbers",
        ),
        (
            changed(REQUEST, "start_state", "joint_state", "position", 0, 0.01),
            SCENE,
            "expected both fingers equally open",
        ),
        (REQUEST, {"world": {}}, "there is no collision_objects"),
        (
            REQUEST,
            changed(SCENE, *OBJECTS, 0, "primitives", 0, "dimensions", [-1, 1]),
            "expected sizes above 0",
        ),
        (
            REQUEST,
            changed(SCENE, *OBJECTS, 0, "primitives", 0, "dimensions", [1e300, 1]),
            "below 100 m",
        ),
        (
            REQUEST,
            changed(SCENE, *OBJECTS, 0, "primitives", 0, "type", "cone"),
            "expected a box, cylinder or sphere, got 'cone'",
        ),
        (REQUEST, changed(SCENE, *OBJECTS, 0, "primitive_poses", []), "1 primitives with 0 poses"),
        (REQUEST, changed(SCENE, *OBJECTS, 0, "meshes", [{}]), "boxes, cylinders and spheres"),
        (
            REQUEST,
            changed(SCENE, *OBJECTS, SCENE["world"]["collision_objects"][:1] * 10_000),
            "10000 obstacles; a scene has room for",
        ),
        (
            REQUEST,
            changed(SCENE, *OBJECTS, 0, "primitive_poses", 0, "orientation", [0.0, 0.0, 0.0, 0.0]),
            "expected a unit quaternion",
        ),
    ],
)
def test_a_damaged_scene_is_refused_in_one_line(tmp_path, request_, scene, said):
    folder = moveit(tmp_path, request_, scene)
    with pytest.raises(FormatError, match=said) as raised:
        import_problems(folder)
    assert "\n" not in str(raised.value) and str(tmp_path) in str(raised.value)


BOMB = "a0: &a0 [9, 9, 9, 9, 9, 9, 9, 9, 9]\n" + "".join(
    f"a{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 9)}]\n" for n in range(1, 12)
)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("!!python/object/apply:os.system ['true']", "not YAML"),
        ("{" * 5000, "not YAML"),
        ("a: [1, 2", "not YAML"),
        ("", "expected families of problems"),
        ("just words", "expected families of problems"),
        (BOMB, "expected fields, among them goal_ik"),
        (f"{BOMB}\nstart: *a11", "expected fields, among them goal_ik"),
        ("box: {}", "expected a list"),
        ("box: [{start: 5, goal_ik: []}]", "expected 7 numbers"),
        ("box: [{goal_ik: []}]", "there is no start"),
        (f"box: [{{goal_ik: [], world_frame: map, start: {START}}}]", "the frame panda_link0"),
        (f"box: [{{goal_ik: [], start: {START}, obstacles: {{mesh: {{}}}}}}]", "got 'mesh'"),
        (f"box: [{{goal_ik: [], start: {START}, obstacles: {{}}}}]", "no problem of it"),
        ("box: [{goal_ik: [], start: [1, 2, 3, 4, 5, 6, " + "9" * 400 + "]}]", "finite numbers"),
    ],
)
def test_a_hostile_file_is_refused_in_one_line_and_nothing_is_written(tmp_path, text, said):
    path, out = tmp_path / "set.yaml", tmp_path / "out.jsonl"
    path.write_text(text)
    with pytest.raises(FormatError, match=said) as raised:
        import_problems(path)
    assert "\n" not in str(raised.value) and len(str(raised.value)) < 400
    assert run("problems", "import", path, "--out", out).exit_code != 0
    assert list(tmp_path.iterdir()) == [path]


def test_other_files_and_two_openings_are_refused(tmp_path):
    for name, said in (
        ("x.pkl", "pickles are not read"),
        ("x.json", "expected a folder of MoveIt"),
    ):
        (tmp_path / name).touch()
        with pytest.raises(FormatError, match=said):
            import_problems(tmp_path / name)
    with pytest.raises(FormatError, match="cannot be read"):
        import_problems(tmp_path / "absent.yaml")
    folder = moveit(tmp_path / "mbm")
    other = changed(REQUEST, "start_state", "joint_state", "position", [0.02, 0.02, *START])
    moveit(folder, other, SCENE, "cage_panda")
    with pytest.raises(FormatError, match=r"\[0.02, 0.065\] m open.*--finger-opening"):
        import_problems(folder)
    assert len(import_problems(folder, finger_opening=0.04).lines) == 3
    (folder / "cage_panda" / "scene0001.yaml").unlink()
    with pytest.raises(FormatError, match="there is no scene0001.yaml beside it"):
        import_problems(folder)
