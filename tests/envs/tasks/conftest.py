"""Two hundred arms, and a task's boxes with nothing but arms about them: no dynamics to compile."""

from functools import cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from drpbench.compile import jit
from drpbench.contract import EPISODE
from drpbench.envs import TASKS, Arm
from drpbench.envs.movers import clearance_of_box, depth_in_core
from drpbench.robot import PANDA

from ...scenes import batch, bodies, postures, problem

COUNT = 200


def arms_at(q):
    """What tasks know of arms at configurations (B, 7)."""
    centers, grip, _, _ = bodies(q)
    radii = np.tile(PANDA.moving_spheres.radius, (len(q), 1))
    return Arm(jnp.asarray(centers), jnp.asarray(radii), jnp.asarray(grip))


@cache
def _alive(name, episode):
    """`reset`, and the boxes of every control step while each arm stays where it is."""
    task = TASKS[name]

    def live(problem, arm, key):
        def step(carry, clock):
            movers, memory = task.advance(*carry, problem, arm, clock, episode)
            return (movers, memory), (movers.position, movers.velocity, movers.active)

        born, memory = task.reset(problem, arm, key, episode)
        (last, memory), steps = jax.lax.scan(step, (born, memory), jnp.arange(episode.steps))
        return born, last, steps, task.valid(memory)

    return jit(jax.vmap(live))


@pytest.fixture(scope="session")
def crowd():
    """200 arms with their goals before them, as problems of levels 1 and 2 by turns; and as
    `Arm`s."""
    q = postures(400, seed=7)
    q = q[bodies(q)[1][:, 0] > -0.2][:COUNT]
    assert len(q) == COUNT
    return batch([problem(q[b], level=1 + b % 2, id=b) for b in range(COUNT)]), arms_at(q)


@pytest.fixture(scope="session")
def lives(crowd):
    """A task's boxes over whole episodes among the 200 arms: born, last, (positions, velocities,
    active) each (200, 1000, M, ...), valid."""

    def run(name, seed=0, episode=EPISODE):
        problems, arms = crowd
        keys = jax.random.split(jax.random.key(seed), COUNT)
        return _alive(name, episode)(problems, arms, keys)

    return run


@pytest.fixture(scope="session")
def rooms():
    """Distance [m] (B, M) of each box to the arm beside it."""

    def room(movers, arm):
        return jax.vmap(clearance_of_box, in_axes=(0, 0, 0, None, None))(
            movers.half_size, movers.rotation, movers.position, arm.centers, arm.radii
        )

    compiled = jit(jax.vmap(room))
    return lambda movers, arms: np.asarray(compiled(movers, arms))


@pytest.fixture(scope="session")
def in_core():
    """How deep [m] any box of an episode, positions (B, T, M, 3), comes into the arm's immovable
    core; every fifth step is looked at."""

    def deepest(half_size, rotation, positions):
        def one(half, turn, places):
            return jax.vmap(lambda place: depth_in_core(half, turn, place, PANDA))(places).max()

        return jax.vmap(one, in_axes=(0, 0, 1))(half_size, rotation, positions)

    compiled = jit(jax.vmap(deepest))

    def run(born, position):
        places = jnp.asarray(position[:, ::5], jnp.float32)
        return np.asarray(compiled(born.half_size, born.rotation, places)).max()

    return run
