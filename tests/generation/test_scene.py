"""Primitives, hand regions and the composition of a scene."""

import numpy as np
import pytest

from drpbench.generation import scene
from drpbench.geometry import host_rotation as rotation
from drpbench.geometry import quaternion_to_matrix


def test_a_bar_runs_from_its_start_to_its_end():
    for end in ((0.3, 0.1, 0.5), (0.1, 0.2, -0.4), (0.1, 0.2, 0.8)):
        start = np.array([0.1, 0.2, 0.3])
        bar = scene.bar(0.01, start, end)
        axis = quaternion_to_matrix(bar.quaternion)[:, 2] * bar.half_size[2]
        ends = [bar.position - axis, bar.position + axis]
        if bar.quaternion is scene.UPRIGHT and end[2] < start[2]:
            ends.reverse()  # a cylinder has no up and down
        np.testing.assert_allclose(ends, [start, end], atol=1e-9)


def test_hands_are_drawn_in_the_box_and_within_tilt_and_roll():
    turn = rotation.axis_angle((0, 0, 1), 0.7)
    region = scene.moved(
        scene.region("here", (0, 0, 0), (0.2, 0.1, 0), (1, 0, 0), (0, 1, 0), 0.3, 0.2),
        np.array([0.5, 0.0, 0.4]),
        turn,
    )
    rng, frame = np.random.default_rng(1), quaternion_to_matrix(turn)
    for _ in range(200):
        position, quaternion = region.draw(rng)
        hand = quaternion_to_matrix(quaternion)
        np.testing.assert_allclose(hand @ hand.T, np.eye(3), atol=1e-9)
        assert np.linalg.det(hand) > 0
        local = frame.T @ (position - (0.5, 0.0, 0.4))
        assert np.all(local >= (-1e-9, -1e-9, -1e-9)) and np.all(
            local <= (0.2 + 1e-9, 0.1 + 1e-9, 1e-9)
        )
        assert hand[:, 2] @ frame[:, 0] >= np.cos(0.3) - 1e-9
        across = frame[:, 1] - (frame[:, 1] @ hand[:, 2]) * hand[:, 2]
        assert abs(hand[:, 1] @ across) / np.linalg.norm(across) >= np.cos(0.2) - 1e-9


def test_placing_furniture_turns_it_about_its_front():
    part = scene.box((0.2, 0.4, 0.6), (0.1, 0.0, 0.3))
    inside = scene.region("in", (0, 0, 0), (0.2, 0, 0), (1, 0, 0), (0, 1, 0), 0.1, 0.1)
    placed = scene.Furniture((part,), (inside,), np.ones(3)).placed((1.0, 2.0, 0.0), np.pi / 2)
    np.testing.assert_allclose(placed.parts[0].position, (1.0, 2.1, 0.3), atol=1e-9)
    np.testing.assert_allclose(placed.tight[0].centre, (1.0, 2.1, 0.0), atol=1e-9)
    forward = quaternion_to_matrix(placed.tight[0].quaternion) @ placed.tight[0].approach
    np.testing.assert_allclose(forward, (0, 1, 0), atol=1e-9)


def test_the_tabletop_is_at_zero_exactly():
    table = scene.compose("none", (), ())
    assert table.obstacles.position[0, 2] + table.obstacles.half_size[0, 2] == 0.0


def test_too_many_obstacles_are_refused():
    ball = scene.sphere(0.01, (1, 0, 0.5))
    crowd = scene.Furniture((ball,) * scene.MAX_OBSTACLES, (), np.ones(3))
    with pytest.raises(ValueError, match="25 obstacles, at most 24"):
        scene.compose("crowd", (crowd,), ())
