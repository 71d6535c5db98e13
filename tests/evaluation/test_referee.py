"""The referee sees what the meshes touch, when, with which link and how deep."""

import mujoco
import numpy as np
import pytest

from drpbench.contract import EPISODE
from drpbench.evaluation import referee
from drpbench.evaluation.referee import Judgement, RefereeError, agreement, judge, judge_episode
from drpbench.geometry import Obstacles
from drpbench.problems import ProblemSet, TaskProblems, load_set
from drpbench.robot import PANDA

needs_meshes = pytest.mark.skipif(PANDA.meshes.find() is None, reason=PANDA.meshes.absent)
SHA = "a" * 64


def among(*boxes) -> TaskProblems:
    """One problem among boxes, each (full size, centre) [m]."""
    n = len(boxes)
    half_size = np.array([size for size, _ in boxes], np.float32).reshape(1, n, 3) / 2
    centre = np.array([centre for _, centre in boxes], np.float32).reshape(1, n, 3)
    return TaskProblems(
        task="FDO",
        obstacles=Obstacles.boxes(half_size, centre, np.tile(np.float32([1, 0, 0, 0]), (1, n, 1))),
        start=PANDA.home[None].astype(np.float32),
        goal=PANDA.home[None].astype(np.float32),
        goal_position=np.zeros((1, 3), np.float32),
        goal_quaternion=np.float32([[1, 0, 0, 0]]),
        family=["box"],
        pair=["ff"],
        level=np.ones(1, np.int32),
        witness=[PANDA.home[None]],
    )


def as_set(problems: TaskProblems, sha256: str = SHA) -> ProblemSet:
    return ProblemSet("drpbench-v1", sha256, {"FDO": problems})


def recording(joints, movers=0) -> dict[str, np.ndarray]:
    """Joints (T + 1, 7), moving evenly between the records, and so many boxes of 0.2 m that do not
    exist."""
    joints = np.asarray(joints, np.float32)
    steps = len(joints) - 1
    return {
        "joint_position": joints,
        "joint_velocity": np.diff(joints, axis=0) / np.float32(EPISODE.period),
        "mover_position": np.zeros((steps, movers, 3), np.float32),
        "mover_active": np.zeros((steps, movers), bool),
        "mover_half_size": np.full((steps, movers, 3), 0.1, np.float32),
        "mover_rotation": np.tile(np.eye(3, dtype=np.float32), (steps, movers, 1, 1)),
    }


def still(steps: int) -> np.ndarray:
    return np.tile(PANDA.home, (steps + 1, 1))


def swing(first: float, last: float, steps: int) -> np.ndarray:
    """HOME, turned about the base's axis."""
    joints = still(steps)
    joints[:, 0] = np.linspace(first, last, steps + 1)
    return joints


@pytest.fixture(scope="module")
def checker():
    if PANDA.meshes.find() is None:
        pytest.skip(PANDA.meshes.absent)
    return referee.mesh_referee()


@pytest.fixture
def row(make_row):
    return make_row("FDO", 0)


@pytest.fixture(scope="module")
def arm():
    """MuJoCo's arm alone: its model and data."""
    if PANDA.meshes.find() is None:
        pytest.skip(PANDA.meshes.absent)
    model = PANDA.meshes.spec(PANDA.meshes.find(), finger_pieces=1).compile()
    return model, mujoco.MjData(model)


def front(arm, q) -> tuple[float, str]:
    """The largest x [m] of any collision geom of link1 to the fingers at joints `q`, and its
    link."""
    model, data = arm
    data.qpos[:7] = q
    mujoco.mj_kinematics(model, data)
    found = []
    for geom in range(model.ngeom):
        mesh, link = model.geom_dataid[geom], model.body(model.geom_bodyid[geom]).name
        if link == "link0":
            continue
        turn = data.geom_xmat[geom].reshape(3, 3)[0]
        if mesh >= 0:
            first, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
            along = (model.mesh_vert[first : first + count] @ turn).max()
        else:  # a box: the fingertips' pads
            along = np.abs(turn) @ model.geom_size[geom]
        found.append((along + data.geom_xpos[geom][0], link))
    return max(found)


def test_an_arm_that_keeps_off_is_free(checker, row):
    wall = among(((0.2, 2.0, 2.0), (1.5, 0.0, 0.5)))
    found = judge_episode(row, recording(swing(-0.3, 0.3, 20)), wall, checker)
    assert not found.collided
    assert (found.first_step, found.link, found.closest_step) == (None, None, None)
    assert found.clearance == referee.MARGIN
    assert found.depth == 0.0


def test_a_wall_is_touched_at_the_right_step_by_the_right_link_and_as_deep(checker, row, arm):
    # A wall across the world, and a reach into it: what is deepest is the farthest vertex in x.
    steps = 30
    joints = still(steps)
    joints[:, 1] += np.linspace(0.0, 0.3, steps + 1)
    joints[:, 5] += np.linspace(0.0, 0.9, steps + 1)
    face = front(arm, PANDA.home)[0] + 0.06
    instants = np.stack([(joints[:-1] + joints[1:]) / 2, joints[1:]], axis=1).reshape(-1, 7)
    ahead = [front(arm, q) for q in instants]
    first = next(i for i, (x, _) in enumerate(ahead) if x > face)
    assert 5 < first < 50

    wall = among(((2.0, 4.0, 4.0), (face + 1.0, 0.0, 0.0)))
    found = judge_episode(row, recording(joints), wall, checker)
    assert found.collided
    assert (found.first_step, found.link) == (first // 2, ahead[first][1])
    assert found.depth == pytest.approx(max(ahead)[0] - face, abs=1e-4)
    assert (found.closest_step, found.closest_link) == (steps - 1, max(ahead)[1])
    assert found.link != found.closest_link


def test_the_clearance_of_a_near_miss_is_exact(checker, row, arm):
    face = front(arm, PANDA.home)[0] + 0.012
    wall = among(((2.0, 4.0, 4.0), (face + 1.0, 0.0, 0.0)))
    found = judge_episode(row, recording(still(2)), wall, checker)
    assert not found.collided
    assert found.clearance == pytest.approx(0.012, abs=1e-4)


def test_the_middle_of_a_control_step_is_looked_at(checker, row):
    # One step carries the hand from one side of a post to the other.
    post = among(((0.02, 0.02, 1.0), (0.31, 0.0, 0.55)))
    joints = swing(-0.8, 0.8, 1)
    for end in joints:
        assert not judge_episode(row, recording([end, end]), post, checker).collided
    found = judge_episode(row, recording(joints), post, checker)
    assert found.collided and found.first_step == 0


def test_a_box_is_where_it_was_recorded_at_that_step(checker, row, arm):
    # A box as wide as the world comes along x, 1 cm a step; only its front face can touch.
    nose = front(arm, PANDA.home)[0]
    steps = 30
    episode = recording(still(steps), movers=1)
    episode["mover_active"][:] = True
    episode["mover_half_size"][:] = [0.5, 2.0, 2.0]
    faces = nose + 0.155 - 0.01 * np.arange(steps)
    episode["mover_position"][:, 0, 0] = faces + 0.5
    found = judge_episode(row, episode, among(), checker)
    assert found.first_step == 16
    assert found.closest_step == 29
    assert found.depth == pytest.approx(nose - faces[-1], abs=1e-4)


def test_boxes_count_only_while_they_exist(checker, row):
    episode = recording(still(20), movers=2)
    episode["mover_position"][:, 1] = [0.3, 0.0, 0.5]
    assert not judge_episode(row, episode, among(), checker).collided
    episode["mover_active"][7:9, 1] = True
    found = judge_episode(row, episode, among(), checker)
    assert found.collided and found.first_step == 7
    assert found.closest_step in (7, 8)


def test_a_box_may_change_size_and_turn_during_an_episode(checker, row, arm):
    nose = front(arm, PANDA.home)[0]
    episode = recording(still(10), movers=1)
    episode["mover_active"][:] = True
    episode["mover_position"][:, 0] = [nose + 0.1, 0.0, 0.4]
    turn = np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1]], np.float32)
    episode["mover_half_size"][:] = [0.05, 0.2, 0.4]
    assert not judge_episode(row, episode, among(), checker).collided
    episode["mover_rotation"][6:] = turn  # its long side lies along x now
    assert judge_episode(row, episode, among(), checker).first_step == 6
    episode["mover_half_size"][4:] = [0.2, 0.2, 0.4]
    assert judge_episode(row, episode, among(), checker).first_step == 4


def test_the_immovable_base_and_the_arm_in_itself_do_not_count(checker, row, arm):
    base = among(((0.3, 0.3, 0.1), (0.0, 0.0, 0.0)))
    assert not judge_episode(row, recording(still(1)), base, checker).collided
    folded = np.array([0.0, -1.2, 0.0, -3.05, 0.0, 0.1, 0.0])
    checker.set_obstacles(Obstacles.absent(0))
    assert checker.clearance(folded) < -0.01
    assert not judge_episode(row, recording([folded, folded]), among(), checker).collided


def test_an_episode_is_judged_up_to_where_it_is_no_longer_a_number(checker, row):
    wall = among(((0.1, 2.0, 2.0), (0.35, 0.0, 0.5)))
    joints = still(4)
    joints[1:] = np.nan
    assert not judge_episode(row, recording(joints), wall, checker).collided
    joints[1] = PANDA.home
    assert judge_episode(row, recording(joints), wall, checker).first_step == 0


def test_the_middle_is_where_the_velocity_leads_back_to(checker, row):
    # The arm bounces: it stands where it stood, and was at the post in the middle of the step.
    post = among(((0.02, 0.02, 1.0), (0.31, 0.0, 0.55)))
    episode = recording(swing(-0.8, -0.8, 1))
    assert not judge_episode(row, episode, post, checker).collided
    episode["joint_velocity"][0, 0] = -0.8 / (EPISODE.period / 2)
    assert judge_episode(row, episode, post, checker).collided


@needs_meshes
@pytest.mark.parametrize("task", ["SE", "SAO"])
def test_the_slots_see_what_a_model_made_for_the_scene_sees(checker, task):
    """Distances over real scenes, against MuJoCo's pairwise distance on a freshly compiled
    model."""
    problems = load_set().task(task)
    rng = np.random.default_rng(0)
    kinds = [
        mujoco.mjtGeom.mjGEOM_BOX,
        mujoco.mjtGeom.mjGEOM_CYLINDER,
        mujoco.mjtGeom.mjGEOM_SPHERE,
    ]
    compared = 0
    for index in range(0, 24, 2):
        scene = problems.obstacles[index].present()
        spec = PANDA.meshes.spec(PANDA.meshes.find())
        arm_geoms = spec.compile().ngeom
        for kind, half, position, quaternion in zip(
            scene.kind, scene.half_size, scene.position, scene.quaternion, strict=True
        ):
            size = [half[0], half[2], 0.0] if kind == 1 else half
            geom = spec.worldbody.add_geom()
            geom.type, geom.size, geom.pos, geom.quat = kinds[kind], size, position, quaternion
        model = spec.compile()
        data = mujoco.MjData(model)
        names = [model.body(body).name for body in model.geom_bodyid]
        obstacles = [g for g in range(model.ngeom) if names[g] == "world"]
        links = [g for g in range(model.ngeom) if names[g] not in ("world", "link0")]
        assert len(obstacles) + len(links) < model.ngeom and arm_geoms < model.ngeom
        checker.set_obstacles(scene)
        for _ in range(16):
            q = rng.uniform(*checker.model.jnt_range[:7].T)
            data.qpos[:7] = q
            mujoco.mj_kinematics(model, data)
            exact = min(
                mujoco.mj_geomDistance(model, data, a, b, referee.MARGIN, None)
                for a in links
                for b in obstacles
            )
            found = referee._closest(checker, q)
            seen = referee.MARGIN if found is None else found[1]
            if exact < -0.03:
                # So deep, the way out is ambiguous: two searches may find different ones.
                assert seen < -0.02
            else:
                assert seen == pytest.approx(exact, abs=1e-4)
                compared += exact < referee.MARGIN
    assert compared > 10


@needs_meshes
def test_judges_a_whole_run(make_result):
    result = make_result(verdicts={"FDO": "x"}, problem_set_sha256=SHA)
    wall = among(((0.1, 2.0, 2.0), (0.35, 0.0, 0.5)))
    (found,) = judge(result, {"FDO-0": recording(still(3))}, as_set(wall))
    assert found.collided and found.agrees


@needs_meshes
def test_refuses_what_it_cannot_judge(make_result):
    result = make_result(verdicts={"FDO": "x"}, problem_set_sha256=SHA)
    episode, problems = recording(still(3), movers=1), among()
    with pytest.raises(RefereeError, match=r"1 of 1 .* FDO-0.*--save-trajectories"):
        judge(result, {}, as_set(problems))
    with pytest.raises(RefereeError, match="run it again"):
        judge(result, {"FDO-0": episode}, as_set(problems, "b" * 64))
    with pytest.raises(RefereeError, match="FDO-0 lacks mover_active"):
        partial = {k: v for k, v in episode.items() if k != "mover_active"}
        judge(result, {"FDO-0": partial}, as_set(problems))
    with pytest.raises(RefereeError, match="FDO-0 is damaged"):
        short = episode | {"joint_position": episode["joint_position"][:-1]}
        judge(result, {"FDO-0": short}, as_set(problems))


def test_says_where_meshes_are_looked_for_when_there_are_none(make_result, monkeypatch, tmp_path):
    monkeypatch.delenv("MENAGERIE_ROOT", raising=False)
    monkeypatch.setenv("DRPBENCH_MESHES", str(tmp_path))
    monkeypatch.setenv("MENAGERIE_CACHE_DIR", str(tmp_path / "none"))
    result = make_result(verdicts={"FDO": "x"}, problem_set_sha256=SHA)
    with pytest.raises(RefereeError) as error:
        judge(result, {"FDO-0": recording(still(1))}, as_set(among()))
    assert str(error.value) == PANDA.meshes.absent


def test_disagreements_are_counted_by_what_explains_them(make_row):
    def judgement(number, spheres_collided, clearance):
        return Judgement(
            make_row("FDO", number, collided=spheres_collided, reached=False),
            clearance, *(None,) * 4,
        )  # fmt: skip

    cases = [
        (True, -0.020), (True, -0.0001), (False, 0.03), (False, 0.0),
        (True, 0.0), (True, 0.004), (True, 0.012), (True, 0.02),
        (False, -0.002), (False, -0.004), (False, -0.006),
    ]  # fmt: skip
    figures = agreement([judgement(i, *case) for i, case in enumerate(cases)])
    assert (figures.episodes, figures.agreed) == (11, 4)
    assert (figures.both_collided, figures.both_free) == (2, 2)
    assert figures.interval[0] < 4 / 11 < figures.interval[1]
    assert figures.disagreements == {
        "spheres stand out from the meshes: true clearance 0 to 5 mm": 2,
        "spheres stand out from the meshes: true clearance 10 to 15 mm": 1,
        "spheres alone, true clearance over 15 mm": 1,
        "meshes alone, by up to 3 mm: the cover's tolerance": 1,
        "meshes alone, by 3 to 5 mm": 1,
        "meshes alone, deeper than 5 mm": 1,
    }
    assert figures.deepest_missed.row.id == 10
    assert figures.deepest_missed.depth == pytest.approx(0.006)


def test_no_episodes_give_no_figure_that_looks_like_one():
    figures = agreement([])
    assert (figures.episodes, figures.interval, figures.deepest_missed) == (0, (0.0, 1.0), None)
