"""The arm with its real meshes, as MuJoCo collides it."""

import mujoco
import numpy as np
import pytest

from drpbench.robot import PANDA
from drpbench.robot.arms.panda.mesh_arm import slabs

needs_meshes = pytest.mark.skipif(PANDA.meshes.find() is None, reason=PANDA.meshes.absent)


def test_slabs_of_a_cube_are_boxes_that_fill_it():
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
    faces = np.array(
        [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
         [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]]
    )  # fmt: skip
    parts = slabs(corners, faces, 4)
    assert len(parts) == 4
    for number, part in enumerate(parts):
        assert part.min(axis=0) == pytest.approx([0, 0, number / 4])
        assert part.max(axis=0) == pytest.approx([1, 1, (number + 1) / 4])


@needs_meshes
def test_has_seven_joints_and_the_links_names():
    model = PANDA.meshes.spec(PANDA.meshes.find()).compile()
    assert (model.nq, model.nu, model.neq, model.ntendon) == (7, 0, 0, 0)
    assert {model.body(body).name for body in range(1, model.nbody)} >= set(PANDA.link_names)


@needs_meshes
def test_a_finger_is_hollow_where_its_hull_is_full():
    # A ball of 1 mm in the bend of the finger, 8 mm inside its hull (finger frame).
    place = [-0.0029, 0.0053, 0.0234]
    distances = []
    for pieces in (1, 8):
        spec = PANDA.meshes.spec(PANDA.meshes.find(), pieces)
        ball = spec.body("left_finger").add_geom()
        ball.name, ball.type, ball.size, ball.pos = (
            "ball",
            mujoco.mjtGeom.mjGEOM_SPHERE,
            [0.001, 0, 0],
            place,
        )
        model = spec.compile()
        data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)
        own = model.geom("ball")
        finger = model.geom_bodyid == own.bodyid[0]
        others = [g for g in np.flatnonzero(finger) if g != own.id]
        distances.append(
            min(mujoco.mj_geomDistance(model, data, g, own.id, 0.05, None) for g in others)
        )
    hull, cut = distances
    assert hull < 0.0
    assert cut == pytest.approx(0.0072, abs=0.002)  # 8.2 mm to the surface less the radius


@needs_meshes
def test_the_pieces_are_as_large_as_the_finger():
    def bounds(pieces):
        model = PANDA.meshes.spec(PANDA.meshes.find(), pieces).compile()
        data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)
        points = []
        for geom in range(model.ngeom):
            mesh = model.geom_dataid[geom]
            if mesh >= 0 and model.body(model.geom_bodyid[geom]).name == "right_finger":
                first, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
                turn = data.geom_xmat[geom].reshape(3, 3)
                points.append(
                    model.mesh_vert[first : first + count] @ turn.T + data.geom_xpos[geom]
                )
        points = np.concatenate(points)
        return np.concatenate([points.min(axis=0), points.max(axis=0)])

    assert bounds(8) == pytest.approx(bounds(1), abs=1e-6)
