"""Single rotations on the host, in double precision: what numbered scenes and problems are drawn
with.

`drpbench.geometry.quaternion_to_matrix` turns these quaternions (w, x, y, z) into matrices.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np


def axis_angle(axis: Sequence[float | int] | np.ndarray, angle: float) -> np.ndarray:
    """Quaternion (4,) of a turn by `angle` [rad] about `axis` (3,), which need not be of unit
    length."""
    direction = np.asarray(axis, float)
    direction = direction / np.linalg.norm(direction)
    return np.concatenate([[np.cos(angle / 2)], np.sin(angle / 2) * direction])


def multiply(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Hamilton product of two quaternions (4,): the rotation b followed by the rotation a."""
    w, x, y, z = a
    return np.array(
        [
            w * b[0] - x * b[1] - y * b[2] - z * b[3],
            w * b[1] + x * b[0] + y * b[3] - z * b[2],
            w * b[2] - x * b[3] + y * b[0] + z * b[1],
            w * b[3] + x * b[2] - y * b[1] + z * b[0],
        ]
    )


def from_matrix(rotation: np.ndarray) -> np.ndarray:
    """Unit quaternion (4,) with w >= 0 of a rotation matrix (3, 3).

    The largest of the four squared components is taken as the pivot, so that no division is by a
    small number (Shepperd, 1978).
    """
    r = rotation
    squares = np.array(
        [
            1 + r[0, 0] + r[1, 1] + r[2, 2],
            1 + r[0, 0] - r[1, 1] - r[2, 2],
            1 - r[0, 0] + r[1, 1] - r[2, 2],
            1 - r[0, 0] - r[1, 1] + r[2, 2],
        ]
    )
    pivot = int(np.argmax(squares))
    skew = [r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]]
    rows = [
        [squares[0], *skew],
        [skew[0], squares[1], r[0, 1] + r[1, 0], r[0, 2] + r[2, 0]],
        [skew[1], r[0, 1] + r[1, 0], squares[2], r[1, 2] + r[2, 1]],
        [skew[2], r[0, 2] + r[2, 0], r[1, 2] + r[2, 1], squares[3]],
    ]
    quaternion = np.array(rows[pivot]) / (2 * np.sqrt(squares[pivot]))
    return -quaternion if quaternion[0] < 0 else quaternion
