"""Compiled collision checkers, made once."""

import numpy as np
import pytest

from drpbench.problems.checker import mesh_checker, sphere_checker
from drpbench.problems.generator import CHECKER_MARGIN
from drpbench.robot import NO_MESHES, find_mesh_model


@pytest.fixture(scope="session")
def spheres():
    return sphere_checker(CHECKER_MARGIN)


@pytest.fixture(scope="session")
def meshes():
    if (model := find_mesh_model()) is None:
        pytest.skip(NO_MESHES)
    return mesh_checker(model, CHECKER_MARGIN)


@pytest.fixture
def obstacles():
    """Arrays for a checker of the table and of (kind, half_size, position) triples."""

    def make(*extra):
        rows = [(0, (0.9, 1.0, 0.025), (0.4, 0.0, -0.025)), *extra]
        return (
            np.array([row[0] for row in rows], np.int32),
            np.array([row[1] for row in rows], np.float32),
            np.array([row[2] for row in rows], np.float32),
            np.tile(np.array([1, 0, 0, 0], np.float32), (len(rows), 1)),
        )

    return make
