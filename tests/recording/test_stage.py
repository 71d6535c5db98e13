"""Pictures show what happened, where it happened."""

from dataclasses import replace

import numpy as np
import pytest

from drpbench.recording import RecordingError, motion, offscreen
from drpbench.recording.stage import Stage
from drpbench.robot import PANDA

try:
    offscreen.choose_platform()
except RecordingError as error:
    pytest.skip(str(error), allow_module_level=True)


@pytest.fixture(scope="module", params=["solids", "meshes"])
def stage(request):
    if request.param == "meshes" and PANDA.meshes.find() is None:
        pytest.skip("no meshes")
    made = Stage(240, 180, PANDA, real=request.param == "meshes")
    yield made
    made.close()


def _share(picture, red, green, blue):
    """Share of the pixels whose channels lie in the bounds."""
    inside = [
        (low <= picture[..., c]) & (picture[..., c] <= high)
        for c, (low, high) in enumerate((red, green, blue))
    ]
    return np.logical_and.reduce(inside).mean()


def test_a_link_in_contact_is_red_and_only_then(stage, rolled):
    b = next(b for b, row in enumerate(rolled.rows) if row.collided)
    episode, seen = rolled.episodes[b], motion(rolled.episodes[b])
    red = (150, 255), (0, 60), (0, 60)
    during = np.flatnonzero(seen.touching)
    shown = [_share(stage.draw(episode, seen, k), *red) for k in during[:: len(during) // 4 or 1]]
    assert max(shown) > 2e-4
    assert _share(stage.draw(episode, seen, 0), *red) == 0.0


def test_boxes_are_drawn_while_they_exist(stage, rolled):
    episode, seen = rolled.episodes[0], motion(rolled.episodes[0])
    blue = (0, 90), (0, 150), (110, 255)
    assert _share(stage.draw(episode, seen, 300), *blue) > 0.005
    assert _share(stage.draw(episode, seen, 900), *blue) == 0.0


def test_the_goal_is_a_ghost_until_the_arm_covers_it(stage, rolled):
    """Where the arm is at its goal, nothing of the ghost is left to see."""
    episode, seen = rolled.episodes[0], motion(rolled.episodes[0])
    orange = (170, 255), (90, 200), (0, 130)
    assert _share(stage.draw(episode, seen, 0), *orange) > 0.005
    there = replace(
        episode,
        id=-1,
        joint_position=np.broadcast_to(episode.problem.goal, episode.joint_position.shape),
    )
    assert _share(stage.draw(there, seen, 900), *orange) < 0.002


def test_every_kind_of_obstacle_is_drawn_at_its_size(rolled, stage):
    """Seen from above and far away, a solid covers the pixels its outline says."""
    from drpbench.geometry import Primitives

    episode, seen = rolled.episodes[0], motion(rolled.episodes[0])
    far = np.array([0.9, 0.0, 0.1])
    areas = {}
    half = np.array([0.10, 0.10, 0.05])
    for kind in (0, 1, 2):
        one = Primitives(
            kind=np.full(1, kind, np.int32),
            half_size=np.where(kind == 2, 0.1, half)[None].astype(np.float32),
            position=far[None].astype(np.float32),
            rotation=np.eye(3, dtype=np.float32)[None],
            mask=np.ones(1, bool),
        )
        none = replace(one, mask=np.zeros(1, bool))
        pictures = []
        for obstacles in (none, one):
            shown = replace(episode, problem=replace(episode.problem, obstacles=obstacles))
            with pytest.MonkeyPatch.context() as patch:
                patch.setattr(stage.camera, "elevation", -90.0)
                patch.setattr(stage.camera, "lookat", far)
                stage._ghosts.clear()
                pictures.append(stage.draw(shown, seen, 900).astype(int))
        stage._ghosts.clear()
        areas[kind] = (np.abs(pictures[1] - pictures[0]).sum(axis=-1) > 20).sum()
    assert areas[0] > 100
    assert areas[1] / areas[0] == pytest.approx(np.pi / 4, rel=0.1)
    assert areas[2] / areas[0] == pytest.approx(np.pi / 4, rel=0.15)


def test_without_a_renderer_it_is_said_what_to_install(monkeypatch):
    monkeypatch.setattr(offscreen, "_WORKS", {"egl": lambda: False, "osmesa": lambda: False})
    monkeypatch.delenv("MUJOCO_GL", raising=False)
    with pytest.raises(RecordingError, match="apt-get install libegl1 libgl1-mesa-dri"):
        offscreen.choose_platform()
    monkeypatch.setenv("MUJOCO_GL", "osmesa")
    with pytest.raises(RecordingError, match="MUJOCO_GL=osmesa does not work here"):
        offscreen.choose_platform()
    monkeypatch.setenv("MUJOCO_GL", "glfw")
    with pytest.raises(RecordingError, match="egl or osmesa"):
        offscreen.choose_platform()


def test_osmesa_is_taken_where_egl_fails(monkeypatch):
    monkeypatch.delenv("MUJOCO_GL", raising=False)
    monkeypatch.setattr(offscreen, "_WORKS", {"egl": lambda: False, "osmesa": lambda: True})
    assert offscreen.choose_platform() == "osmesa"


@pytest.mark.skipif(PANDA.meshes.find() is None, reason=PANDA.meshes.absent)
def test_fingers_that_can_move_are_drawn_open(rolled):
    """As the spheres have them: each 4 cm from the middle."""
    made, episode = Stage(64, 48, PANDA), rolled.episodes[0]
    made.draw(episode, motion(episode), 0)
    made.close()
    left, right = (made._data.body(f"{side}_finger").xpos for side in ("left", "right"))
    assert np.linalg.norm(left - right) == pytest.approx(0.08, abs=1e-6)
