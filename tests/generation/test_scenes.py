"""Scenes of no family, and foreign ones: whole, solvable, and apart from each other."""

import numpy as np
import pytest

from drpbench.generation.training_problems import (
    ABROAD,
    AT_HOME,
    FAMILY_NAMES,
    LEARNED_FROM,
    SCENES,
    Drawer,
)
from drpbench.geometry import MAX_OBSTACLES
from drpbench.planning.checker import sphere_checker

ANYWHERE = ("assembly", *ABROAD)


@pytest.mark.parametrize("name", ANYWHERE)
def test_scenes_are_whole(name):
    rng = np.random.default_rng(0)
    bearings = []
    for _ in range(40):
        scene = SCENES[name](rng)
        there = scene.obstacles.present()
        assert 1 <= there.count <= MAX_OBSTACLES
        assert np.isfinite(there.position).all() and (there.half_size > 0).all()
        np.testing.assert_allclose(np.linalg.norm(there.quaternion, axis=1), 1.0, atol=1e-5)
        # What bears the arm comes first: its top is at the base or a little below.
        top = there.position[0, 2] + there.half_size[0, 2]
        assert -0.05 < top <= 1e-6
        assert scene.tight and scene.free
        centre = scene.tight[0].centre
        bearings.append(np.arctan2(centre[1], centre[0]))
    assert np.ptp(bearings) > 1.5  # not in front of the arm alone


@pytest.mark.parametrize("name", ANYWHERE)
def test_problems_in_them_are_free_at_both_ends(name):
    checker = sphere_checker()
    drawer = Drawer("tests", families=(name,))
    for number in range(2):
        one = drawer.draw(number)
        assert FAMILY_NAMES[one.family] == name
        checker.set_obstacles(one.obstacles)
        assert checker.free(one.start) and checker.free(one.goal) != one.obstructed


def test_nothing_is_learned_from_foreign_scenes():
    assert not set(ABROAD) & set(LEARNED_FROM) and set(AT_HOME) < set(LEARNED_FROM)


def test_unknown_families_are_refused():
    with pytest.raises(ValueError, match=r"expected families of box, .*got boat"):
        Drawer("tests", families=("box", "boat"))
