"""How boxes are drawn and how they drift."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from drpbench.compile import jit
from drpbench.contract import Movers, no_movers
from drpbench.envs.movers import (
    clearance_of_box,
    depth_in_core,
    drift,
    first_clear,
    in_upper_shell,
    random_heading,
    random_rotation,
)
from drpbench.robot import PANDA

CUBE = jnp.full(3, 0.1)
AHEAD = jnp.array([[0.5, 0.0, 0.0]])  # one sphere of 0.1 m
RADIUS = jnp.array([0.1])


def one_box(position, velocity):
    return Movers(
        half_size=CUBE[None],
        rotation=jnp.eye(3)[None],
        position=jnp.array([position], jnp.float32),
        velocity=jnp.array([velocity], jnp.float32),
        active=jnp.ones(1, bool),
    )


def test_boxes_that_do_not_exist_are_masked_obstacles():
    boxes = no_movers(3).primitives()
    assert boxes.count == 3 and not boxes.mask.any()


def test_clearance_is_from_face_to_sphere():
    found = clearance_of_box(CUBE, jnp.eye(3), jnp.zeros(3), AHEAD, RADIUS)
    assert float(found) == pytest.approx(0.3, abs=1e-6)
    inside = clearance_of_box(CUBE, jnp.eye(3), jnp.array([0.35, 0.0, 0.0]), AHEAD, RADIUS)
    assert float(inside) == pytest.approx(-0.05, abs=1e-6)


def test_the_shell_is_filled_evenly_above_its_centre():
    center = jnp.array([0.1, 0.2, 0.3])
    draw = jit(jax.vmap(lambda key: in_upper_shell(key, center, 0.5, 0.6)))
    offset = np.asarray(draw(jax.random.split(jax.random.key(0), 4000))) - np.asarray(center)
    radius = np.linalg.norm(offset, axis=1)
    assert 0.5 - 1e-6 <= radius.min() < 0.501 and 0.599 < radius.max() <= 0.6 + 1e-6
    direction = offset / radius[:, None]
    assert direction[:, 2].min() >= 0.0
    # Archimedes: heights on a hemisphere are uniform.
    np.testing.assert_allclose(np.histogram(direction[:, 2], 4, (0, 1))[0] / 4000, 0.25, atol=0.03)
    assert np.abs(direction[:, :2].mean(axis=0)).max() < 0.03


def test_a_heading_deviates_from_its_aim_as_told():
    aim = jnp.array([0.0, 3.0, 4.0])
    draw = jit(jax.vmap(lambda key: random_heading(key, aim, 0.1)))
    velocity = np.asarray(draw(jax.random.split(jax.random.key(0), 4000)))
    speed = np.linalg.norm(velocity, axis=1)
    np.testing.assert_allclose(np.histogram(speed, 4, (0.001, 0.003))[0] / 4000, 0.25, atol=0.03)
    # Across the aim, the unit heading has 0.1 on each of two axes.
    np.testing.assert_allclose(np.std(velocity[:, 0] / speed), 0.1, rtol=0.05)
    np.testing.assert_allclose(
        (velocity / speed[:, None]).mean(axis=0), [0, 0.594, 0.792], atol=0.01
    )


def test_rotations_are_proper_and_without_preference():
    draw = jit(jax.vmap(random_rotation))
    found = np.asarray(draw(jax.random.split(jax.random.key(0), 4000)))
    np.testing.assert_allclose(np.linalg.det(found), 1.0, atol=1e-5)
    np.testing.assert_allclose(found.mean(axis=0), 0.0, atol=0.04)


@pytest.fixture(scope="module")
def placed():
    """Where a box goes along x when 32 places in [0, 1] are drawn, those below 0.3 are not allowed,
    and the arm is one sphere at x = 0.5; and the places drawn."""

    def draw(key):
        return jnp.array([1.0, 0.0, 0.0]) * jax.random.uniform(key)

    def placed(room):
        def one(key):
            place = first_clear(
                draw, lambda p: p[0] >= 0.3, key, room, CUBE, jnp.eye(3), AHEAD, RADIUS
            )
            return place[0], jax.vmap(draw)(jax.random.split(key, 32))[:, 0]

        return map(np.asarray, jit(jax.vmap(one))(jax.random.split(jax.random.key(0), 50)))

    return placed


def test_the_first_allowed_place_with_room_is_taken(placed):
    for place, drawn in zip(*placed(0.1), strict=True):
        clear = (np.abs(drawn - 0.5) - 0.2 > 0.1) & (drawn >= 0.3)
        assert place == drawn[clear.argmax()]


def test_where_none_has_room_the_one_with_most_is_taken(placed):
    for place, drawn in zip(*placed(10.0), strict=True):
        allowed = drawn[drawn >= 0.3]
        assert place == allowed[np.abs(allowed - 0.5).argmax()]


def test_a_box_turns_back_at_the_border_and_not_before():
    box, trail = one_box([0.0, 0.0, 0.0], [0.003, 0.0, 0.0]), []
    step = jit(lambda box: drift(box, lambda position: position[:, 0] - 0.01, PANDA))
    for _ in range(10):
        box = step(box)
        trail.append(float(box.position[0, 0]))
    np.testing.assert_allclose(
        trail, [0.003, 0.006, 0.009, 0.009, 0.006, 0.003, 0, -0.003, -0.006, -0.009], atol=1e-8
    )


def test_a_box_that_is_beyond_the_border_may_come_back():
    box = one_box([0.05, 0.0, 0.0], [-0.003, 0.0, 0.0])
    moved = drift(box, lambda position: position[:, 0] - 0.01, PANDA)
    assert float(moved.position[0, 0]) == pytest.approx(0.047)
    np.testing.assert_array_equal(moved.velocity, box.velocity)


@pytest.mark.slow
def test_a_box_turns_back_before_what_the_arm_cannot_move_away():
    box, depths = one_box([0.45, 0.02, 0.2], [-0.003, 0.0, 0.0]), []
    step = jit(lambda box: drift(box, lambda position: jnp.full(len(position), -1.0), PANDA))
    depth = jit(lambda position: depth_in_core(CUBE, jnp.eye(3), position, PANDA))
    for _ in range(150):
        box = step(box)
        depths.append(float(depth(box.position[0])))
    assert -0.003 < max(depths) <= 0.0  # it comes within a step's length, and no nearer
    assert float(box.velocity[0, 0]) == pytest.approx(0.003)
