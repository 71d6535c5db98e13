"""One list of an observation's fields: whoever shows, checks or describes observations follows
it."""

import ast
import threading
from dataclasses import fields

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from drpbench.contract import OBSERVED, HostObservation, Observation, observation_spec
from drpbench.envs import TASKS, World
from drpbench.gym.spaces import action_space, observation_space
from drpbench.perception import SurfaceCloud
from drpbench.plugins.errors import PolicyError
from drpbench.plugins.host import HANDED, Failed, Hosted
from drpbench.plugins.imported import check, nothing_seen
from drpbench.plugins.remote import Remote, packed
from drpbench.plugins.scaffold import write
from drpbench.policies import Straight

from ..plugins.test_remote import example, free_port  # noqa: F401
from ..scenes import problem
from ..toy_arm import toy_arm

POINTS, ROBOT_POINTS, COUNT = 300, 40, 3


@pytest.fixture(scope="module")
def robot(tmp_path_factory):
    return toy_arm(tmp_path_factory.mktemp("toy"))


@pytest.fixture(scope="module")
def spec(robot):
    return observation_spec(robot, POINTS, ROBOT_POINTS)


@pytest.fixture(scope="module")
def seen(spec):
    """What three instances show."""
    return jax.tree.map(lambda leaf: jnp.stack([leaf] * COUNT), nothing_seen(spec))


class Keeps:
    """A host policy that keeps what it saw, and answers `targets`."""

    def __init__(self, joints=4):
        self.targets = np.zeros((COUNT, joints))

    def reset(self, observation):
        self.seen = observation

    def act(self, observation):
        return self.targets


def assert_follows(shown, spec):
    """Whether attributes of `shown` are the spec's, with instances in front."""
    for name, of in spec.items():
        array = np.asarray(getattr(shown, name))
        assert array.shape == (COUNT, *of.shape) and array.dtype == of.dtype, name


def test_the_spec_has_the_fields_of_an_observation_in_their_order(spec):
    assert [*spec, "obstacles"] == [field.name for field in fields(Observation)]
    assert tuple(spec) == OBSERVED == tuple(observation_spec())
    assert all(of.meaning and of.bound > 0.0 for of in spec.values())


@pytest.mark.parametrize("task", ["SE", "FDO"])
def test_a_worlds_observation_is_as_its_spec_says(task):
    world = World(TASKS[task], sensor=SurfaceCloud(POINTS), robot_points=ROBOT_POINTS)
    assert world.spec == observation_spec(world.robot, POINTS, ROBOT_POINTS)

    def seen(problem, key):
        found = world.observe(world.reset(problem, key))
        return {name: getattr(found, name) for name in OBSERVED}

    found = jax.eval_shape(seen, problem(), jax.random.key(0))
    assert {name: (leaf.shape, leaf.dtype) for name, leaf in found.items()} == {
        name: (of.shape, of.dtype) for name, of in world.spec.items()
    }


def test_a_host_policy_is_shown_the_specs_arrays_and_asked_for_its_joints(seen, spec):
    policy = Keeps()
    hosted = Hosted(policy, Keeps)
    hosted.reset(seen, COUNT)
    assert_follows(policy.seen, spec)
    assert hosted.act(seen, COUNT).shape == (COUNT, 4)
    policy.targets = np.zeros((COUNT, 7))
    with pytest.raises(Failed, match=r"shape: \(3, 7\), not \(3, 4\)"):
        hosted.act(seen, COUNT)


def test_a_host_observation_has_the_specs_arrays_and_no_others(spec):
    arrays = {name: np.zeros((COUNT, *of.shape), of.dtype) for name, of in spec.items()}
    found = HostObservation(**arrays)
    assert vars(found).keys() == {*spec, "obstacles"} and found.obstacles is None
    with pytest.raises(AttributeError, match="no 'joint_positions'; it has: joint_position, "):
        found.joint_positions  # noqa: B018
    for wrong in (arrays | {"image": 0}, {"scene_mask": arrays["scene_mask"]}):
        with pytest.raises(TypeError, match="expected the arrays joint_position, "):
            HostObservation(**wrong)


def test_the_check_of_imported_policies_follows_the_spec(robot, spec):
    check("right", Straight(robot=robot), spec)
    # The Panda's limits do not go with four joints.
    with pytest.raises(PolicyError, match="act failed"):
        check("wrong", Straight(), spec)
    with pytest.raises(PolicyError, match="act failed"):
        check("wrong", Straight(robot=robot), observation_spec())


def test_a_remote_policy_receives_the_specs_arrays(example, seen, spec):  # noqa: F811
    class Remembers(example.Approach):
        def reset(self, observation):
            self.seen = observation

    policy, address = Remembers(), f"127.0.0.1:{free_port()}"
    threading.Thread(target=example.serve, args=(policy, address), daemon=True).start()
    handed, _ = HANDED["numpy"](seen, COUNT, policy)
    remote = connected(address)
    remote.reset(handed)
    assert_follows(policy.seen, spec)
    assert vars(policy.seen).keys() == spec.keys()
    assert remote.act(handed).shape == (COUNT, 4)
    assert packed("act").startswith(b"DRP1")


def connected(address):
    for _ in range(50):
        try:
            return Remote(address, 5.0)
        except PolicyError:
            threading.Event().wait(0.1)
    raise AssertionError("nobody answers")


def test_the_scaffold_describes_the_spec(tmp_path, spec):
    files = write("own-idea", tmp_path, frozenset(), spec)
    source = next(path for path in files if path.name == "policy.py").read_text()
    (made,) = [node for node in ast.parse(source).body if isinstance(node, ast.ClassDef)]
    (act,) = [node for node in made.body if getattr(node, "name", "") == "act"]
    told = ast.get_docstring(act)
    assert "targets (B, 4) [rad]" in told
    for name, of in spec.items():
        (line,) = [line for line in told.splitlines() if line.startswith(f"{name} ")]
        shape = ", ".join(["B", *map(str, of.shape)])
        assert f"({shape})" in line and of.meaning in line
    test = next(path for path in files if path.name == "test_policy.py").read_text()
    assert "(2, 5, 4)" in test and "(5, 7)" not in test


def test_the_spaces_follow_the_spec(robot, spec):
    space = observation_space(spec)
    assert {name: (box.shape, box.dtype) for name, box in space.items()} == {
        name: (of.shape, of.dtype) for name, of in spec.items()
    }
    assert {name: np.asarray(value) for name, value in space.sample().items()}.keys() == {*spec}
    assert action_space(robot).shape == (4,)
