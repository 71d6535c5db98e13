"""The collision checkers against MuJoCo models compiled for one scene alone, and against each
other."""

import json

import mujoco
import numpy as np
import pytest

from drpbench.errors import DrpbenchError
from drpbench.generation.families import FAMILIES
from drpbench.geometry import BOX, CYLINDER, SPHERE, Obstacles
from drpbench.robot import PANDA


def compiled_alone(scene, margin):
    """A model of the spheres and this one scene, with nothing written in afterwards."""
    spec = mujoco.MjSpec.from_file(str(PANDA.model))
    spec.option.disableflags = 0
    for link, spheres in json.loads((PANDA.folder / "spheres.json").read_text()).items():
        assert link in PANDA.link_names
        for x, y, z, radius in spheres:
            geom = spec.body(link).add_geom()
            geom.type, geom.size, geom.pos = mujoco.mjtGeom.mjGEOM_SPHERE, [radius, 0, 0], [x, y, z]
            geom.contype, geom.conaffinity = 1, 0
    types = {
        BOX: mujoco.mjtGeom.mjGEOM_BOX,
        CYLINDER: mujoco.mjtGeom.mjGEOM_CYLINDER,
        SPHERE: mujoco.mjtGeom.mjGEOM_SPHERE,
    }
    there = scene.obstacles
    for kind, half, position, quaternion in zip(
        there.kind, there.half_size, there.position, there.quaternion, strict=True
    ):
        geom = spec.worldbody.add_geom()
        geom.type = types[int(kind)]
        geom.size = [half[0], half[2], 0] if kind == CYLINDER else half
        geom.pos, geom.quat, geom.margin = position, quaternion, margin
        geom.contype, geom.conaffinity = 0, 1
    return spec.compile()


def near_home(count, seed):
    rng = np.random.default_rng(seed)
    return np.clip(
        PANDA.home + rng.normal(0, 0.6, (count, 7)), PANDA.joint_lower, PANDA.joint_upper
    )


def test_more_obstacles_than_there_are_slots_for_are_refused(spheres):
    with pytest.raises(DrpbenchError, match="25 obstacles: .* room for 24"):
        spheres.set_obstacles(
            Obstacles.boxes(np.ones((25, 3)), np.zeros((25, 3)), np.ones((25, 4)))
        )


@pytest.mark.parametrize("family", FAMILIES)
def test_a_scene_written_in_place_is_as_one_compiled_for_it(family, spheres):
    for seed in range(3):
        scene = FAMILIES[family](np.random.default_rng([5, seed]))
        spheres.set_obstacles(scene.obstacles)
        model = compiled_alone(scene, spheres.margin)
        data = mujoco.MjData(model)
        for q in near_home(60, seed):
            data.qpos[:] = q
            mujoco.mj_kinematics(model, data)
            mujoco.mj_collision(model, data)
            expected = min([spheres.margin, *data.contact.dist])
            found = [d for a, b, d in spheres.contacts(q) if "obstacle" in a + b]
            assert min([spheres.margin, *found]) == pytest.approx(expected, abs=1e-7)


def test_the_last_scene_leaves_nothing_behind(spheres, obstacles):
    spheres.set_obstacles(obstacles((BOX, (0.5, 0.5, 0.5), (0.5, 0.0, 0.5))))
    assert not spheres.free(PANDA.home)
    spheres.set_obstacles(obstacles())
    assert spheres.clearance(PANDA.home) == spheres.margin


def test_distance_to_a_slab_below_the_fingers_is_told(spheres, meshes, obstacles):
    for checker in (spheres, meshes):
        checker.set_obstacles(obstacles())
        grip, _ = checker.grip_pose(PANDA.home)
        slab = (BOX, (0.1, 0.1, 0.01), grip - (0, 0, 0.03 + 0.01))
        checker.set_obstacles(obstacles(slab))
        # The fingertips reach 0.0124 m beyond the grip frame, so 0.0176 m remain.
        assert checker.clearance(PANDA.home) == pytest.approx(0.0176, abs=0.004)
        assert checker.contacts(PANDA.home)[0][:2] in {
            ("left_finger", "obstacle 1"),
            ("obstacle 1", "right_finger"),
        }


def test_a_folded_arm_collides_with_itself_in_both_models(spheres, meshes, obstacles):
    folded = np.array([0.0, 1.7, 0.0, -3.0, 0.0, -0.01, 0.0])
    touching = np.array([0.0, -1.0, 0.0, -3.0, 0.0, 0.5, 0.0])
    for checker in (spheres, meshes):
        checker.set_obstacles(obstacles())
        assert not checker.free(folded) or not checker.free(touching)
        pairs = [(a, b) for q in (folded, touching) for a, b, d in checker.contacts(q) if d < 0]
        assert any("obstacle" not in a + b for a, b in pairs)


def test_whatever_the_meshes_hit_by_3_mm_the_spheres_hit(spheres, meshes):
    scene = FAMILIES["shelf"](np.random.default_rng(2))
    spheres.set_obstacles(scene.obstacles)
    meshes.set_obstacles(scene.obstacles)
    rooms = np.array([(spheres.clearance(q), meshes.clearance(q)) for q in near_home(1500, 3)])
    assert (rooms < 0).mean() > 0.05
    # The spheres leave no surface point of the meshes more than 3 mm uncovered.
    assert np.all(rooms[rooms[:, 1] < -0.0035, 0] < 0)


def test_furniture_in_the_base_is_seen_though_nothing_moves_there(spheres, obstacles):
    spheres.set_obstacles(obstacles((BOX, (0.1, 0.1, 0.05), (0.15, 0.0, 0.05))))
    assert spheres.base_clearance() < 0
    spheres.set_obstacles(obstacles((BOX, (0.1, 0.1, 0.05), (0.5, 0.0, 0.05))))
    assert spheres.base_clearance() == spheres.margin
