"""A certificate accepts what is free and says what is wrong with what is not."""

import numpy as np
import pytest

from drpbench.generation.certificate import CLEARANCE, RESOLUTION, certify
from drpbench.robot import PANDA

LEFT, RIGHT = PANDA.home + [0.8, 0, 0, 0, 0, 0, 0], PANDA.home - [0.8, 0, 0, 0, 0, 0, 0]
LINE = np.stack([LEFT, RIGHT])
WALL = (0, (0.2, 0.01, 0.35), (0.55, 0.0, 0.35))
SLAT = (0, (0.2, 0.001, 0.35), (0.55, 0.0, 0.35))  # 2 mm thin: nothing falls between two samples


def test_a_free_line_is_accepted(spheres, meshes, obstacles):
    for checker in (spheres, meshes):
        checker.set_obstacles(obstacles())
    proof = certify(LINE, LEFT, RIGHT, spheres, meshes)
    assert proof.fault is None
    assert proof.samples > 1.6 * 0.5 / RESOLUTION  # 1.6 rad at about 0.5 m from the first axis
    assert proof.sphere_clearance >= CLEARANCE and proof.mesh_clearance > 0


@pytest.mark.parametrize("obstacle", [WALL, SLAT], ids=["wall", "slat"])
def test_a_witness_through_a_wall_is_rejected(obstacle, spheres, obstacles):
    spheres.set_obstacles(obstacles(obstacle))
    assert spheres.free(LEFT, CLEARANCE) and spheres.free(RIGHT, CLEARANCE)
    assert "spheres come to" in certify(LINE, LEFT, RIGHT, spheres, None).fault


def test_the_meshes_reject_what_the_spheres_alone_do_not_see(spheres, meshes, obstacles):
    spheres.set_obstacles(obstacles())
    meshes.set_obstacles(obstacles(WALL))
    assert "meshes collide" in certify(LINE, LEFT, RIGHT, spheres, meshes).fault


def test_an_end_closer_than_5_mm_is_rejected(spheres, obstacles):
    spheres.set_obstacles(obstacles())
    grip, _ = spheres.grip_pose(LEFT)
    for gap, accepted in ((0.003, False), (0.009, True)):
        # A slab under the fingertips.
        top = 0.0
        for _ in range(60):  # its height by bisection, so that `gap` is what the spheres see
            slab = (0, (0.1, 0.1, 0.01), grip - (0, 0, 0.02 + 0.05 - top))
            spheres.set_obstacles(obstacles(slab))
            if abs(spheres.clearance(LEFT) - gap) < 2e-4:
                break
            top += 0.5 * (spheres.clearance(LEFT) - gap)
        still = LEFT[None]
        fault = certify(still, LEFT, LEFT, spheres, None).fault
        assert (fault is None) == accepted
        assert accepted or "the start is" in fault


def test_malformed_witnesses_are_named(spheres, obstacles):
    spheres.set_obstacles(obstacles())
    cases = {
        "does not lead": LINE[::-1],
        "no finite array": np.full((2, 7), np.nan),
        "7-joint": np.zeros((2, 6)),
        "joint limit": np.stack([LEFT, PANDA.joint_upper + 0.01, RIGHT]),
    }
    for words, witness in cases.items():
        assert words in certify(witness, LEFT, RIGHT, spheres, None).fault
