"""Points on the arm where C MuJoCo puts its bodies, and self-collision against brute force."""

import json

import jax
import mujoco
import numpy as np
import pytest

from drpbench.compile import jit
from drpbench.robot import PANDA
from drpbench.robot.arms.panda.fingers import FINGER_OPENING

FRAMES = 9  # link0 to link7, and the hand with its fingers


def configurations(count, seed=0):
    """Uniform within the joint limits, as the float32 values that JAX sees."""
    q = np.random.default_rng(seed).uniform(PANDA.joint_lower, PANDA.joint_upper, (count, 7))
    return q.astype(np.float32)


def worlds(points):
    """Compiled: world positions (N, S, 3) of body points at configurations (N, 7)."""
    return jit(jax.vmap(lambda q: points.world(PANDA.link_poses(q))))


@jit
@jax.vmap
def clearances(q):
    """`self_clearance` (N,) at configurations (N, 7)."""
    return PANDA.self_clearance(PANDA.link_poses(q))


def as_written(name):
    """The numbers in a data file: {link: (n, 3 or 4)}."""
    text = (PANDA.folder / name).read_text()
    return {link: np.array(values) for link, values in json.loads(text).items()}


@pytest.mark.parametrize("path", [PANDA.model, PANDA.meshes.find()], ids=["own", "real"])
@pytest.mark.parametrize(
    ("points", "name"),
    [(PANDA.spheres, "spheres.json"), (PANDA.surface, "surface.json")],
    ids=["spheres", "surface"],
)
def test_points_stand_where_mujoco_puts_their_links(path, points, name):
    if path is None:
        pytest.skip(PANDA.meshes.absent)
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    written = as_written(name)
    q = configurations(50)
    for row, found in zip(q, np.asarray(worlds(points)(q)), strict=True):
        data.qpos[:] = FINGER_OPENING
        data.qpos[:7] = row
        mujoco.mj_kinematics(model, data)
        for index, link in enumerate(PANDA.link_names):
            own = points.link == index
            if link not in written:
                assert not own.any()
                continue
            body = data.body(link)
            expected = written[link][:, :3] @ body.xmat.reshape(3, 3).T + body.xpos
            np.testing.assert_allclose(found[own], expected, atol=1e-5)


def test_every_link_has_spheres_and_every_moving_link_surface_points():
    assert set(as_written("spheres.json")) == set(PANDA.link_names)
    assert set(as_written("surface.json")) == set(PANDA.link_names) - {"link0"}
    assert np.all(PANDA.spheres.radius > 0.0)
    np.testing.assert_array_equal(PANDA.surface.radius, 0.0)
    assert PANDA.surface.count >= 256


@pytest.mark.parametrize("points", [PANDA.spheres, PANDA.moving_spheres, PANDA.surface])
def test_points_are_sorted_by_frame_and_link(points):
    assert points.count == len(points.link) == len(points.local) == len(points.radius)
    assert np.all(np.diff(points.link) >= 0)
    np.testing.assert_array_equal(points.frame, np.minimum(points.link, 8))


def test_moving_spheres_are_all_but_the_base_links():
    every, moving = PANDA.spheres, PANDA.moving_spheres
    assert moving.count == (every.link > 0).sum() < every.count
    np.testing.assert_array_equal(moving.local, every.local[every.link > 0])


def test_a_part_keeps_what_was_picked_in_order():
    every = PANDA.spheres
    picked = np.array([5, 2, 40])
    part = every.part(picked)
    np.testing.assert_array_equal(part.local, every.local[picked])
    np.testing.assert_array_equal(part.link, every.link[picked])
    assert part.count == 3


def block_pairs():
    """The pairs of frames that `self_clearance` looks at."""
    return {
        (min(a, b), max(a, b))
        for first, second in PANDA.self_collision_blocks
        for a in first
        for b in second
    }


@pytest.fixture(scope="module")
def crowd():
    """20,000 random configurations: `self_clearance`, and by brute force each pair of frames'."""
    q = configurations(20_000, seed=7)
    model = PANDA.spheres
    clearance = np.asarray(clearances(q))
    # Neighbours always overlap; link5 and link7 share a housing.
    pairs = [(i, j) for i in range(FRAMES) for j in range(i + 2, FRAMES) if (i, j) != (5, 7)]
    by_pair = {pair: [] for pair in pairs}
    place = worlds(model)
    for chunk in np.array_split(q, 80):
        every = np.asarray(place(chunk))
        centre = [every[:, model.frame == i] for i in range(FRAMES)]
        radius = [model.radius[model.frame == i] for i in range(FRAMES)]
        for i, j in pairs:
            square = sum(
                (centre[i][:, :, None, k] - centre[j][:, None, :, k]) ** 2 for k in range(3)
            )
            gap = np.sqrt(square) - radius[i][:, None] - radius[j]
            by_pair[i, j].append(gap.min(axis=(1, 2)))
    return clearance, {pair: np.concatenate(gaps) for pair, gaps in by_pair.items()}


def test_self_clearance_is_the_smallest_gap_of_its_pairs(crowd):
    clearance, by_pair = crowd
    expected = np.min([by_pair[pair] for pair in block_pairs()], axis=0)
    np.testing.assert_allclose(clearance, expected, atol=2e-6)


def test_no_other_pair_of_links_collides_unseen(crowd):
    clearance, by_pair = crowd
    for pair, gap in by_pair.items():
        if pair not in block_pairs():
            unseen = (gap < 0.0) & (clearance >= 0.0)
            assert not unseen.any(), f"frames {pair} collide unseen in {unseen.sum()} of 20,000"


def test_self_collision_is_neither_rare_nor_common(crowd):
    clearance, _ = crowd
    assert 0.01 < (clearance < 0.0).mean() < 0.3


def test_the_arm_is_free_at_home_and_collides_when_folded():
    # The elbow closed all the way drives hand and wrist into the shoulder.
    folded = [0.0, 0.0, 0.0, -3.07, 0.0, 0.0, 0.0]
    # The hand laid back onto the forearm.
    tucked = [0.0, 0.0, 0.0, -1.6, 0.0, -0.0175, -0.24]
    free, *collided = clearances(np.array([PANDA.home, folded, tucked], np.float32))
    assert free > 0.03
    assert max(collided) < -0.02


def test_deep_self_collisions_of_the_real_meshes_are_seen():
    path = PANDA.meshes.find()
    if path is None:
        pytest.skip(PANDA.meshes.absent)
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    frame = np.minimum(np.array(model.geom_bodyid) - 1, 8)
    q = configurations(2_000, seed=8)
    clearance = np.asarray(clearances(q))
    collisions = 0
    for row, seen in zip(q, clearance, strict=True):
        data.qpos[:] = FINGER_OPENING
        data.qpos[:7] = row
        mujoco.mj_kinematics(model, data)
        mujoco.mj_collision(model, data)
        pair = frame[data.contact.geom]
        # MuJoCo fills each mesh up to its convex hull, so neighbours and what is beside them touch.
        apart = np.abs(pair[:, 0] - pair[:, 1]) >= 2
        depth = np.max(-data.contact.dist[apart], initial=0.0)
        collisions += depth > 0.006
        # Spheres leave at most 3 mm of each of the two meshes uncovered.
        assert depth < 0.006 or seen < 0.0
    assert collisions > 50
