"""Planning asks a distance field, not the primitives: another kind of field leads the arm as
well."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from drpbench.generation.certificate import certify
from drpbench.geometry import Field
from drpbench.planning.expert import PlannerSettings, planner
from drpbench.planning.path_check import CLEARANCE
from drpbench.robot import PANDA

from ..scenes import boxes
from .voxels import voxels

BOX = ((0.45, 0.0, 0.3), (0.25, 0.05, 0.3))
LEFT, RIGHT = ((PANDA.home + [side, 0, 0, 0, 0, 0, 0]).astype(np.float32) for side in (1.0, -1.0))


@pytest.fixture(scope="module")
def field():
    return voxels(boxes(BOX), low=(-0.4, -1.0, -0.2), high=(1.0, 1.0, 1.3), spacing=0.02)


@pytest.mark.slow
def test_the_grid_is_a_field_and_near_the_primitives_own(field):
    assert isinstance(field, Field) and isinstance(boxes(BOX), Field)
    assert not isinstance(field.values, Field)
    points = jnp.asarray(
        np.random.default_rng(0).uniform((-0.3, -0.9, 0), (0.9, 0.9, 1.2), (500, 3))
    )
    distance, normal = field.distance_and_normal(points)
    exact, straight = boxes(BOX).distance_and_normal(points)
    np.testing.assert_allclose(distance, exact, atol=0.01)
    np.testing.assert_allclose(field.distance(points), distance)
    # Near edges of the field's medial surface directions differ.
    assert np.mean(np.sum(np.asarray(normal * straight), axis=1) > 0.98) > 0.95


@pytest.mark.slow
def test_the_expert_leads_round_what_a_voxel_grid_holds(field, spheres, obstacles):
    spheres.set_obstacles(obstacles((0, BOX[1], BOX[0])))
    line = LEFT + np.linspace(0, 1, 50)[:, None] * (RIGHT - LEFT)
    assert min(spheres.clearance(q) for q in line) < 0.0
    settings = PlannerSettings(iterations=12, vias=3)
    batch = jax.tree.map(lambda leaf: leaf[None], (field, LEFT, RIGHT))
    plan = planner(settings)(*batch, jax.random.key(0)[None], None)
    assert bool(plan.reached[0]) and float(plan.clearance[0]) >= CLEARANCE
    # By the box itself, and by another engine.
    assert certify(np.asarray(plan.path[0]), LEFT, RIGHT, spheres, None).fault is None
