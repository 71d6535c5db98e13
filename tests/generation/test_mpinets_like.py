"""The set in Motion Policy Networks' ranges: what it is made of, and that its problems hold."""

from collections import Counter

import numpy as np
import pytest

from drpbench.generation import certificate, mpinets_like
from drpbench.generation.mpinets_like import FAMILIES, NAME, SIZE, group_of
from drpbench.geometry import BOX, CYLINDER
from drpbench.problems import load_set

PUBLISHED = {"cubby": 300, "merged_cubby": 300, "dresser": 600, "tabletop": 600}


@pytest.mark.parametrize("family", FAMILIES)
def test_scenes_are_within_reach_and_their_hands_are_drawn(family):
    for seed in range(100):
        scene = FAMILIES[family](np.random.default_rng(seed))
        again = FAMILIES[family](np.random.default_rng(seed))
        np.testing.assert_array_equal(scene.obstacles.position, again.obstacles.position)
        assert scene.family == family and scene.obstacles.count <= 24
        assert (scene.obstacles.half_size > 0).all()
        assert scene.tight and scene.free
        for region in scene.tight:
            assert (region.half_extent >= 0).all() and np.linalg.norm(region.centre) < 1.3


def test_tables_hold_the_published_sizes():
    for seed in range(30):
        obstacles = FAMILIES["tabletop"](np.random.default_rng(seed)).obstacles
        tops = obstacles.position[1, 2] + obstacles.half_size[1, 2]
        assert 0.0 <= tops <= 0.4 + 1e-6
        front = obstacles.position[1, 0] - obstacles.half_size[1, 0]
        assert 0.275 - 1e-6 <= front <= 0.375 + 1e-6
        things = obstacles.half_size[3:]
        assert (things[:, :2] <= 0.075 + 1e-6).all() and (things[:, 2] <= 0.175 + 1e-6).all()


def test_a_merged_cubby_lacks_one_wall():
    for seed in range(10):
        whole, merged = (
            FAMILIES[name](np.random.default_rng(seed)) for name in ("cubby", "merged_cubby")
        )
        assert merged.obstacles.count == whole.obstacles.count - 1
        assert len(merged.tight) == len(whole.tight) - 1 == 3


def test_any_prefix_is_a_sample():
    first = [group_of("SE", index) for index in range(24)]
    assert Counter(group.family for group in first) == {
        name: count // 75 for name, count in PUBLISHED.items()
    }
    assert Counter(group.pair for group in first) == {"ft": 6, "tf": 6, "tt": 12}


def test_the_frozen_set_has_as_many_of_each_as_the_original():
    found = load_set(NAME)
    assert found.tasks == ("SE",) and not found.ground
    problems = found.task("SE")
    assert problems.count == SIZE == 1800
    assert Counter(problems.family) == PUBLISHED
    for family, count in PUBLISHED.items():
        of = Counter(p for p, f in zip(problems.pair, problems.family, strict=True) if f == family)
        assert of == {"ft": count // 4, "tf": count // 4, "tt": count // 2}
    kinds = problems.obstacles.kind[problems.obstacles.mask]
    assert set(np.unique(kinds)) == {BOX, CYLINDER}


def test_certificates_of_a_sample_hold_by_spheres_and_by_meshes(spheres, meshes):
    problems = load_set(NAME).task("SE")
    for index in np.random.default_rng(3).choice(problems.count, 40, replace=False):
        for checker in (spheres, meshes):
            checker.set_obstacles(problems.obstacles[index])
        found = certificate.certify(
            problems.witness[index].astype(float),
            problems.start[index].astype(float),
            problems.goal[index].astype(float),
            spheres,
            meshes,
        )
        assert found.fault is None, (index, found.fault)


def test_it_is_another_set_than_the_benchmark(tmp_path, monkeypatch):
    assert load_set(NAME).sha256 != load_set().sha256
    assert mpinets_like.NAME == NAME
    monkeypatch.chdir(tmp_path)
    (tmp_path / NAME).write_text("no set")  # a file of that name comes first
    with pytest.raises(Exception, match="expected one JSON object"):
        load_set(NAME)
