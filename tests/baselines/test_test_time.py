"""Test-time optimisation: of the ways that are drawn, the one that touches least is tracked."""

from dataclasses import dataclass, field, replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from drpbench.baselines import TestTimeOptimisation
from drpbench.compile import jit
from drpbench.learning.batches import cloud
from drpbench.planning.clearance_cost import gaps
from drpbench.plugins.errors import PolicyError
from drpbench.plugins.registry import make
from drpbench.robot import PANDA

from ..scenes import observation
from .posts import GOAL, START, post

pytestmark = pytest.mark.slow


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Either:
    """Goes to the goal in a bow, above or below as its first key says; by itself, never."""

    draws: bool = field(default=False, metadata={"static": True})
    short: bool = field(default=False, metadata={"static": True})
    """Whether it stops half way wherever the bow is above."""

    privileged = False

    def drawn(self):
        return replace(self, draws=True)

    def init(self, observation):
        return observation.joint_position, jnp.float32(0.0), jnp.int32(0)

    def act(self, observation, carry, key):
        start, side, step = carry
        drawn = jnp.where(jax.random.uniform(key) < 0.5, 1.0, -1.0)
        side = jnp.where(step == 0, drawn, side)
        share = jnp.minimum((step + 1) / 15.0, 1.0)
        share = jnp.where(self.short & (side > 0), jnp.minimum(share, 0.5), share)
        bow = jnp.zeros_like(start).at[1].set(0.5 * side * jnp.sin(jnp.pi * share))
        target = start + share * (observation.goal_joints - start) + bow
        return target if self.draws else start, (start, side, step + 1)


def tracked(policy, bearing):
    """(400, J) where the arm is led, past a post at this bearing [rad]."""
    seen = observation(jnp.asarray(START), jnp.asarray(GOAL))
    points, mask = cloud(
        jax.random.key(1), jax.tree.map(jnp.asarray, post(bearing)), len(seen.scene_points)
    )
    seen = replace(seen, scene_points=points, scene_mask=mask)

    def episode(seen):
        def step(carry, _):
            target, carry = policy.act(seen, carry, None)
            return carry, target

        return jax.lax.scan(step, policy.init(seen), length=400)[1]

    return np.asarray(jit(episode)(seen))


def room(way, bearing):
    """[m] the least gap between the arm on its way and the post."""
    scene = jax.tree.map(jnp.asarray, post(bearing))
    return float(jax.vmap(lambda q: gaps(q, scene).obstacle.min())(jnp.asarray(way[::8])).min())


@pytest.fixture(scope="module")
def ways():
    few = {"rollouts": 8, "steps": 20}
    return {
        "free": tracked(TestTimeOptimisation(Either(), **few), 0.7),
        "only below": tracked(TestTimeOptimisation(Either(short=True), **few), 2.5),
    }


def test_the_way_that_touches_least_is_tracked_to_the_goal(ways):
    way = ways["free"]
    np.testing.assert_allclose(way[-1], GOAL, atol=1e-3)
    assert np.abs(way[:, 1] - START[1]).max() > 0.3
    other = way.copy()
    other[:, 1] = 2 * START[1] - way[:, 1]  # the other bow
    rooms = [room(bow, 0.7) for bow in (way, other)]
    assert rooms[0] > rooms[1] + 0.01
    speed = np.abs(np.diff(way, axis=0)) * 60 / PANDA.velocity_limit
    assert speed.max() < 0.75


def test_a_way_that_does_not_end_at_the_goal_is_not_taken(ways):
    way = ways["only below"]
    np.testing.assert_allclose(way[-1], GOAL, atol=1e-3)
    assert way[:, 1].min() < START[1] - 0.3


def test_it_goes_over_those_that_draw():
    with pytest.raises(PolicyError, match=r"^tto: draws ways from a policy that can.*neuralmp"):
        make("straight+tto")
