"""A world to drive arms in, compiled once: 16 worlds of two boxes, without moving obstacles."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from drpbench.compile import jit
from drpbench.envs import TASKS, World

LANES, STEPS = 16, 400


@pytest.fixture(scope="session")
def drive():
    """Drives 16 arms from their starts towards fixed targets (16, 7) for 400 control steps.

    Returns joint positions and velocities (400, 16, 7), servo references (400, 16, 7), clearance,
    sphere (400, 16) and finite (400, 16).
    """
    world = World(TASKS["SE"])

    def episode(problems, targets):
        def step(states, clock):
            states, events = jax.vmap(world.step, in_axes=(0, 0, None))(states, targets, clock)
            return states, {
                "q": states.joint_position,
                "qd": states.joint_velocity,
                "reference": states.reference,
                "clearance": events.clearance,
                "sphere": events.sphere,
                "finite": events.finite,
            }

        states = jax.vmap(lambda problem: world.reset(problem, jax.random.key(0)))(problems)
        return jax.lax.scan(step, states, jnp.arange(STEPS))[1]

    compiled = jit(episode)

    def run(problems, targets=None):
        targets = problems.goal if targets is None else targets
        assert targets.shape == (LANES, 7)
        return jax.tree.map(np.asarray, compiled(problems, targets))

    return run
