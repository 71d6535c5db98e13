"""OMPL's planners as a policy: they go round, and what fails costs its own instance."""

import faulthandler
import os
import time

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from drpbench.baselines import Ompl
from drpbench.baselines.forked import Lost, each_alone
from drpbench.baselines.tracking import evenly
from drpbench.errors import DrpbenchError
from drpbench.geometry import Primitives
from drpbench.planning.clearance_cost import gaps
from drpbench.robot import PANDA

from .posts import GOAL, START, batch, post

pytest.importorskip("ompl")


@jax.jit
def nearest(way):
    """[m] the least gap between the arm on its way (50, J) and the post at 0.7 rad."""
    scene = Primitives(**{n: jnp.asarray(v) for n, v in vars(post(0.7)).items()})
    return jax.vmap(lambda q: gaps(q, scene).obstacle.min())(jnp.asarray(way)).min()


@pytest.fixture(scope="module")
def policy():
    made = Ompl("rrtconnect", time_limit=5.0, processes=2)
    yield made
    made.close()


def test_it_goes_round_and_a_taken_goal_costs_its_own_instance(policy):
    seen = batch(0.7, 1.4)
    policy.reset(seen)
    assert policy.failures == ("", "planner: the goal touches something")
    way = []
    for _ in range(400):
        targets = policy.act(seen)
        assert targets.shape == (2, PANDA.joints)
        way.append(targets)
    way = np.stack(way, 1)
    np.testing.assert_allclose(way[0, -1], GOAL, atol=1e-3)
    np.testing.assert_array_equal(way[1], np.broadcast_to(START, way[1].shape))
    straight = START + np.linspace(0, 1, 50)[:, None] * (GOAL - START)
    assert nearest(straight) < 0
    assert nearest(way[0, ::8]) > 0.005
    fastest = np.abs(np.diff(way[0], axis=0)).max(0) / policy.control_period
    assert (fastest <= PANDA.velocity_limit).all()


def test_the_same_seed_finds_the_same_path(policy):
    first, second = policy.paths(batch(0.7))[0], policy.paths(batch(0.7))[0]
    np.testing.assert_array_equal(first, second)


def test_it_plans_again_where_it_is_asked_to(policy):
    again = Ompl("rrtconnect", replan=10, processes=1)
    blocked, open_ = batch(1.4), batch(-2.0)
    again.reset(blocked)
    assert again.failures == ("",)
    for clock in range(400):
        target = again.act(blocked if clock < 15 else open_)
        if clock < 20:
            np.testing.assert_array_equal(target[0], START)
        open_.joint_position = target.astype(np.float32)
    again.close()
    np.testing.assert_allclose(target[0], GOAL, atol=1e-2)


def test_a_planner_that_died_is_started_again(policy):
    policy._server.kill()
    policy._server.wait()
    policy.reset(batch(-2.0))
    assert policy.failures == ("",)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ({"planner": "bistar"}, "no planner 'bistar'.*did you mean 'bitstar'"),
        ({"time_limit": 0.0}, "time_limit=0: expected more than 0"),
        ({"time_limit": float("nan")}, "expected more than 0"),
        ({"replan": -1}, "expected 0 or more"),
        ({"interpreter": "/no/python"}, "there is no such program"),
        ({"interpreter": "true"}, "no drpbench of this version"),
    ],
)
def test_what_is_not_as_expected_is_one_line(arguments, said):
    with pytest.raises(DrpbenchError, match=said) as error:
        Ompl(**arguments)
    assert "\n" not in str(error.value)


def _job(number):
    if number == 1:
        faulthandler.disable()  # the crash is meant; no stack in the tests' output
        os.abort()
    if number == 2:
        time.sleep(60)
    if number == 3:
        raise ValueError
    return number


@pytest.mark.filterwarnings("ignore:.*fork")
def test_what_crashes_or_hangs_costs_its_own_job():
    began = time.monotonic()
    found = dict(each_alone(_job, range(6), processes=2, patience=2.0))
    assert time.monotonic() - began < 20
    assert {k: found[k] for k in (0, 4, 5)} == {0: 0, 4: 4, 5: 5}
    assert all(isinstance(found[k], Lost) for k in (1, 2, 3))
    assert [str(found[k]) for k in (1, 2, 3)] == [
        "crashed (SIGABRT)",
        "did not end within 2 s, and was killed",
        "raised an error",
    ]


def test_even_waypoints_keep_the_ends_and_have_even_steps():
    path = np.array([START, START + 0.5, GOAL], float)
    even = evenly(path, 41, PANDA)
    np.testing.assert_allclose(even[[0, -1]], path[[0, -1]], atol=1e-6)
    steps = np.max(np.abs(np.diff(even, axis=0)) / PANDA.velocity_limit, 1)
    assert steps.std() < 0.1 * steps.mean()
