"""Each family draws what its name says, from primitives, in the arm's reach."""

import numpy as np
import pytest

from drpbench.generation.composition import COMPOSITION
from drpbench.generation.families import FAMILIES, FURNISHED
from drpbench.geometry import BOX, CYLINDER, MAX_OBSTACLES, SPHERE, quaternion_to_matrix

SEEDS = range(40)
SHOULDER = np.array([0.0, 0.0, 0.333])
REACH = 0.855 + 0.107 + 0.1  # [m] of the grip from the shoulder, stretched


def draws(family):
    return [FAMILIES[family](np.random.default_rng([7, seed])) for seed in SEEDS]


def extent(scene):
    """Half extents (n, 3) of the obstacles' bounding boxes along the world's axes."""
    turns = np.array([quaternion_to_matrix(q) for q in scene.obstacles.quaternion.astype(float)])
    extents = np.einsum("nij,nj->ni", np.abs(turns), scene.obstacles.half_size)
    axis = turns[:, :, 2]
    radius, half = scene.obstacles.half_size[:, :1], scene.obstacles.half_size[:, 2:]
    round_ = np.abs(axis) * half + radius * np.sqrt(np.clip(1 - axis**2, 0, 1))
    extents = np.where(scene.obstacles.kind[:, None] == CYLINDER, round_, extents)
    return np.where(scene.obstacles.kind[:, None] == SPHERE, scene.obstacles.half_size, extents)


def boxes(scene):
    """Sorted full extents (m, 3) of the boxes, the table left out: thickness first."""
    chosen = scene.obstacles.kind == BOX
    chosen[0] = False
    return np.sort(2 * scene.obstacles.half_size[chosen], axis=1)


@pytest.mark.parametrize("family", FAMILIES)
def test_obstacles_are_proper_and_stand_on_the_table(family):
    for scene in draws(family):
        assert scene.family == family
        assert 1 <= scene.obstacles.count <= MAX_OBSTACLES
        assert (
            scene.obstacles.kind[0] == BOX
            and scene.obstacles.position[0, 2] + scene.obstacles.half_size[0, 2] == 0.0
        )
        assert np.all(scene.obstacles.half_size > 0.002)
        assert np.all(scene.obstacles.half_size[1:] < 0.7)
        np.testing.assert_allclose(np.linalg.norm(scene.obstacles.quaternion, axis=1), 1, atol=1e-6)
        lowest = (scene.obstacles.position - extent(scene))[1:, 2]
        assert np.all(lowest > -1e-6), "nothing is sunk into the table"
        assert np.all(np.linalg.norm(scene.obstacles.position[1:, :2], axis=1) < 1.3)


@pytest.mark.parametrize("family", FAMILIES)
def test_hand_regions_are_within_reach(family):
    for scene in draws(family):
        assert scene.free and (scene.tight or family == "table")
        for region in scene.tight:
            assert np.linalg.norm(region.centre - SHOULDER) < REACH + 0.1, region.place
        near = [np.linalg.norm(r.centre - SHOULDER) < REACH for r in (*scene.free, *scene.tight)]
        assert np.mean(near) > 0.8


@pytest.mark.parametrize("family", FURNISHED)
def test_furniture_keeps_clear_of_the_arms_base(family, spheres):
    clear = 0
    for scene in draws(family):
        spheres.set_obstacles(scene.obstacles)
        clear += spheres.base_clearance() > 0.02
    assert clear > 0.9 * len(SEEDS)


def test_families_are_those_of_the_benchmark():
    named = {group.family for groups in COMPOSITION.values() for group in groups}
    assert named == set(FAMILIES)
    assert {group.family for group in COMPOSITION["SE"]} == set(FURNISHED)


def test_one_seed_draws_one_scene():
    for family in FAMILIES:
        a, b, c = (FAMILIES[family](np.random.default_rng(seed)) for seed in (3, 3, 4))
        assert np.array_equal(a.obstacles.position, b.obstacles.position)
        assert np.array_equal(a.obstacles.half_size, b.obstacles.half_size)
        assert family == "table" or not np.array_equal(a.obstacles.position, c.obstacles.position)


def test_boxes_are_open_to_the_top():
    for scene in draws("box"):
        inside = next(r for r in scene.tight if r.place == "in the box")
        # Nothing with its middle above the box's inside, but a floor below it.
        offsets = np.abs(scene.obstacles.position[1:, :2] - inside.centre[:2])
        over = np.all(offsets < 0.05, axis=1) & (scene.obstacles.position[1:, 2] > inside.centre[2])
        assert not over.any()
        assert (boxes(scene)[:, 0] < 0.021).sum() >= 5, "four walls and a floor"


def test_cages_are_bars_on_a_plate():
    for scene in draws("cage"):
        bars = (scene.obstacles.kind == CYLINDER) & (scene.obstacles.half_size[:, 0] < 0.02)
        assert bars.sum() >= 17
        upright = [
            abs(quaternion_to_matrix(q)[2, 2]) > 0.99
            for q in scene.obstacles.quaternion[bars].astype(float)
        ]
        assert sum(upright) >= 13


def test_cubbies_are_grids_of_compartments():
    for scene in draws("cubby"):
        compartments = len(scene.tight)
        assert compartments in (4, 6, 9)
        assert (boxes(scene)[:, 0] < 0.021).sum() >= 3 + 2 + 1 + compartments // 3


def test_dishwashers_have_a_door_down_and_plates_in_the_rack():
    for scene in draws("dishwasher"):
        axes = np.array(
            [quaternion_to_matrix(q)[:, 2] for q in scene.obstacles.quaternion.astype(float)]
        )
        plates = (
            (scene.obstacles.kind == CYLINDER)
            & (scene.obstacles.half_size[:, 0] > 0.07)
            & (scene.obstacles.half_size[:, 2] < 0.01)
            & (np.abs(axes[:, 2]) < 0.01)
        )
        assert plates.sum() >= 3
        door = (scene.obstacles.kind == BOX) & (
            np.abs(2 * scene.obstacles.half_size[:, 2] - 0.025) < 1e-6
        )
        assert door.sum() == 1 and scene.obstacles.position[door, 2] < 0.05


def test_hybrids_hold_more_than_one_thing():
    for scene in draws("hybrid"):
        places = {region.place.split(" ")[0] for region in scene.tight}
        loose = ((scene.obstacles.position - extent(scene))[1:, 2] < 1e-6).sum()
        assert len(places) > 1 or len({r.place for r in scene.tight}) > 1 or loose >= 4


def test_microwaves_have_an_opened_door_with_a_handle_and_a_turntable():
    for scene in draws("microwave"):
        turntable = (
            (scene.obstacles.kind == CYLINDER)
            & (scene.obstacles.half_size[:, 0] > 0.12)
            & (scene.obstacles.half_size[:, 2] < 0.01)
        )
        handle = (scene.obstacles.kind == CYLINDER) & (
            np.abs(scene.obstacles.half_size[:, 0] - 0.009) < 1e-6
        )
        door = (scene.obstacles.kind == BOX) & (
            np.abs(2 * scene.obstacles.half_size - 0.024) < 1e-6
        ).any(axis=1)
        assert turntable.sum() == handle.sum() == door.sum() == 1
        # Open: the door's yaw is not the oven's.
        body = np.argmax(scene.obstacles.kind[1:] == BOX) + 1
        yaws = [
            2 * np.arctan2(scene.obstacles.quaternion[i, 3], scene.obstacles.quaternion[i, 0])
            for i in (body, np.argmax(door))
        ]
        assert np.cos(yaws[0] - yaws[1]) < 0.0


def test_shelves_are_level_boards_at_a_hands_distance():
    for scene in draws("shelf"):
        width = (2 * scene.obstacles.half_size).max(axis=1)
        boards = (
            (scene.obstacles.kind == BOX)
            & (2 * scene.obstacles.half_size[:, 2] < 0.026)
            & (width > 0.6)
        )
        boards[0] = False
        heights = np.sort(scene.obstacles.position[boards, 2])
        assert len(heights) in (3, 4)
        assert np.all(np.diff(heights) > 0.2)
        assert scene.obstacles.count >= 10, "boards, sides and what stands on them"


def test_wall_cabinets_hang_high_with_two_open_doors():
    for scene in draws("wall_cabinet"):
        low, high = (scene.obstacles.position + sign * extent(scene) for sign in (-1, 1))
        wall = (low[:, 2] < 1e-6) & (high[:, 2] > 0.8)
        pots = (low[:, 2] < 1e-6) & (high[:, 2] < 0.25)
        hanging = ~wall & ~pots
        assert wall.sum() == 1
        assert np.all(low[hanging, 2] > 0.3)
        doors = (scene.obstacles.kind == BOX) & (
            np.abs(2 * scene.obstacles.half_size[:, 0] - 0.016) < 1e-6
        )
        assert doors.sum() == 2
