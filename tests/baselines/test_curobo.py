"""The adapter to cuRobo against a stand-in with its published interface: what it hands over, and
what it makes of the answer."""

import sys
from dataclasses import dataclass, field
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest

from drpbench.baselines import Curobo
from drpbench.errors import DrpbenchError
from drpbench.geometry import BOX, CYLINDER, SPHERE, Primitives

from .posts import GOAL, START, batch


class Tensor(np.ndarray):
    def cpu(self):
        return self

    def numpy(self):
        return np.asarray(self)


@dataclass
class Solid:
    name: str
    pose: list
    dims: list = None
    radius: float = None
    height: float = None


@dataclass
class Scene:
    cuboid: list = field(default_factory=list)
    cylinder: list = field(default_factory=list)
    sphere: list = field(default_factory=list)
    checkable: bool = False

    def get_collision_check_world(self):
        return Scene(self.cuboid, self.cylinder, self.sphere, checkable=True)


class MotionPlanner:
    """Goes by way of a posture aside, but where the first joint would not move."""

    joint_names = [f"panda_joint{i}" for i in range(1, 8)]

    def __init__(self, settings):
        self.settings, self.scenes, self.asked = settings, [], []

    def warmup(self):
        self.warm = True

    def update_world(self, scene):
        self.scenes.append(scene)

    def plan_cspace(self, goal_state, current_state, max_attempts):
        self.asked.append((goal_state, current_state, max_attempts))
        goal, start = goal_state["position"], current_state["position"]
        assert goal.shape == start.shape == (1, 7)
        if abs(goal[0, 0] - start[0, 0]) < 1e-6:
            return None
        aside = 0.5 * (goal + start) + np.array([0, 0.2, 0, 0, 0, 0, 0], np.float32)
        way = np.stack([start, aside, goal], axis=1)[:, None].view(Tensor)  # (1, 1, 3, 7)
        plan = SimpleNamespace(position=way)
        return SimpleNamespace(success=np.array([[True]]), get_interpolated_plan=lambda: plan)


class JointState:
    @staticmethod
    def from_position(position, joint_names):
        return {"position": position, "joint_names": joint_names}


@pytest.fixture
def curobo(monkeypatch):
    """The modules that the adapter imports."""
    made = {
        "curobo": {},
        "curobo.motion_planner": {
            "MotionPlanner": MotionPlanner,
            "MotionPlannerCfg": SimpleNamespace(create=lambda **settings: settings),
        },
        "curobo.scene": {"Scene": Scene, "Cuboid": Solid, "Cylinder": Solid, "Sphere": Solid},
        "curobo.types": {"JointState": JointState},
        "torch": {
            "cuda": SimpleNamespace(is_available=lambda: True),
            "float32": np.float32,
            "tensor": lambda q, device, dtype: np.array(q, dtype).view(Tensor),
        },
    }
    for name, content in made.items():
        module = ModuleType(name)
        vars(module).update(content)
        monkeypatch.setitem(sys.modules, name, module)
    return sys.modules


def test_it_hands_over_the_problem_and_tracks_the_answer(curobo):
    policy = Curobo(replan=0, attempts=3)
    planner = policy._planner
    assert planner.warm and planner.settings["robot"] == "franka.yml"
    seen = batch(0.7, 1.4)
    policy.reset(seen)
    assert policy.failures == ("", "")
    (goal, start, attempts), _ = planner.asked
    assert attempts == 3 and start["joint_names"] == planner.joint_names
    np.testing.assert_allclose(start["position"][0], START)
    np.testing.assert_allclose(goal["position"][0], GOAL)
    way = np.stack([policy.act(seen) for _ in range(400)], 1)
    np.testing.assert_allclose(way[:, -1], [GOAL, GOAL], atol=1e-3)
    assert (way[..., 1].max(1) > START[1] + 0.15).all()  # by way of the posture aside
    assert len(planner.asked) == 2


def test_it_plans_again_and_a_problem_without_a_path_stays_where_it_is(curobo):
    seen = batch(0.7, 1.4)
    seen.goal_joints[1] = START
    policy = Curobo(replan=15)
    policy.reset(seen)
    way = np.stack([policy.act(seen) for _ in range(31)], 1)
    assert len(policy._planner.asked) == 2 * 3
    np.testing.assert_allclose(way[1], np.broadcast_to(START, way[1].shape), atol=1e-6)
    assert policy.failures == ("", "")
    once = Curobo(replan=0)
    once.reset(seen)
    assert once.failures == ("", "planner: cuRobo found no path")


def test_solids_keep_their_sizes_and_places(curobo):
    turned = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])  # about z
    obstacles = Primitives(
        kind=np.array([[BOX, CYLINDER, SPHERE, BOX]], np.int32),
        half_size=np.array([[[0.1, 0.2, 0.3], [0.05, 0.05, 0.4], [0.06] * 3, [9, 9, 9]]], float),
        position=np.arange(12, dtype=float).reshape(1, 4, 3),
        rotation=np.stack([turned, np.eye(3), np.eye(3), np.eye(3)])[None],
        mask=np.array([[True, True, True, False]]),
    )
    from drpbench.baselines.curobo import scene

    found = scene(sys.modules["curobo.scene"], obstacles, 0)
    assert found.checkable
    (box,), (cylinder,), (ball,) = found.cuboid, found.cylinder, found.sphere
    np.testing.assert_allclose(box.dims, [0.2, 0.4, 0.6])
    half = np.sqrt(0.5)
    np.testing.assert_allclose(box.pose, [0, 1, 2, half, 0, 0, half], atol=1e-6)
    np.testing.assert_allclose((cylinder.radius, cylinder.height), (0.05, 0.8))
    np.testing.assert_allclose(cylinder.pose, [3, 4, 5, 1, 0, 0, 0])
    assert ball.radius == 0.06
    assert len({solid.name for solid in (box, cylinder, ball)}) == 3


def test_what_is_missing_is_said_in_one_line(curobo, monkeypatch):
    with pytest.raises(DrpbenchError, match=r"^curobo: speed=0: expected more than 0$"):
        Curobo(speed=0.0)
    with pytest.raises(DrpbenchError, match="attempts of 1 or more"):
        Curobo(attempts=0)
    monkeypatch.setattr(curobo["torch"].cuda, "is_available", lambda: False)
    with pytest.raises(DrpbenchError, match="^curobo: there is no CUDA device"):
        Curobo()
    monkeypatch.setitem(sys.modules, "curobo.motion_planner", None)
    with pytest.raises(DrpbenchError, match="^curobo: needs NVIDIA's cuRobo 0.8") as raised:
        Curobo()
    assert "\n" not in str(raised.value)
