"""Certificates: a witness trajectory is free of collision, by two models of the arm.

A witness is a polyline in joint space. It is sampled so finely that between two samples no point of
the arm moves more than `RESOLUTION`. At every sample the collision spheres keep at least
`CLEARANCE`, half of that resolution: every configuration between two samples is within `CLEARANCE`
of motion from one of them, so the spheres cannot touch an obstacle there either. The real meshes,
in C MuJoCo, are checked at the same samples.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from drpbench.planning import motion
from drpbench.planning.checker import Checker

RESOLUTION = 0.01  # [m] of motion between samples
CLEARANCE = 0.005  # [m] by the spheres everywhere, by the meshes at start and goal


@dataclass(frozen=True)
class Certificate:
    """Outcome of a check: `fault` says in words what is wrong, None that nothing is.

    The smallest clearances [m] are cut off at the checkers' margins; `mesh_clearance` is None
    where no meshes were at hand.
    """

    fault: str | None
    samples: int
    sphere_clearance: float
    mesh_clearance: float | None


def certify(
    witness: np.ndarray,
    start: np.ndarray,
    goal: np.ndarray,
    spheres: Checker,
    meshes: Checker | None,
) -> Certificate:
    """Checks a witness (m, J) [rad] from `start` (J,) to `goal` (J,) in the checkers' scene.

    Both checkers must be of the same arm and hold the same scene. A witness of a single waypoint
    stands still.
    """
    robot = spheres.robot
    witness = np.asarray(witness, float)
    if witness.ndim != 2 or witness.shape[1] != robot.joints or not np.all(np.isfinite(witness)):
        return _fault(
            f"the witness is no finite array of {robot.joints}-joint waypoints: {witness.shape}"
        )
    if not (np.array_equal(witness[0], start) and np.array_equal(witness[-1], goal)):
        return _fault("the witness does not lead from start to goal")
    if np.any(witness < robot.joint_lower) or np.any(witness > robot.joint_upper):
        return _fault("a waypoint is beyond a joint limit")
    for name, checker in (("spheres", spheres), ("meshes", meshes)):
        for end, q in (("start", start), ("goal", goal)):
            if checker is not None and (found := checker.clearance(q)) < CLEARANCE:
                return _fault(f"the {end} is {1000 * found:.1f} mm clear by the {name}")
    path = motion.samples(witness, RESOLUTION, robot)
    by_spheres = np.array([spheres.clearance(q) for q in path])
    by_meshes = None if meshes is None else np.array([meshes.clearance(q) for q in path])
    fault = None
    if by_spheres.min() < CLEARANCE:
        fault = (
            f"the spheres come to {1000 * by_spheres.min():.1f} mm at sample {by_spheres.argmin()}"
        )
    elif by_meshes is not None and by_meshes.min() <= 0:
        fault = (
            f"the meshes collide ({1000 * by_meshes.min():.1f} mm) at sample {by_meshes.argmin()}"
        )
    return Certificate(
        fault,
        len(path),
        float(by_spheres.min()),
        None if by_meshes is None else float(by_meshes.min()),
    )


def _fault(words: str) -> Certificate:
    return Certificate(words, 0, np.nan, None)
