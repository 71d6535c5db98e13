"""Clamped cubic B-splines as matrices: a path is `basis @ control_points`.

Optimising control points instead of waypoints makes every path twice continuously differentiable
and leaves few unknowns. The curve lies in the control points' convex hull: joint limits that hold
for them hold for it.
"""

from functools import cache

import numpy as np
from scipy.interpolate import BSpline

_DEGREE = 3


def _knots(control_points: int) -> np.ndarray:
    inner = np.linspace(0.0, 1.0, control_points - _DEGREE + 1)
    return np.concatenate([np.zeros(_DEGREE), inner, np.ones(_DEGREE)])


@cache
def basis(control_points: int, count: int) -> np.ndarray:
    """(count, control_points): values of the basis functions at `count` equal steps of s in [0,
    1]."""
    s = np.linspace(0.0, 1.0, count)
    return BSpline.design_matrix(s, _knots(control_points), _DEGREE).toarray().astype(np.float32)


@cache
def energy(control_points: int, velocity: float, acceleration: float, jerk: float) -> np.ndarray:
    """(control_points, control_points) R with c^T R c = sum of weights times integrals over s in
    [0, 1] of q'(s)^2, q''(s)^2 and q'''(s)^2, exact by Gauss-Legendre quadrature.
    """
    knots = _knots(control_points)
    spans = np.unique(knots)
    nodes, weights = np.polynomial.legendre.leggauss(_DEGREE)
    half = np.diff(spans)[:, None] / 2
    s = (spans[:-1, None] + half * (nodes + 1)).ravel()
    weight = (half * weights).ravel()
    curves = BSpline(knots, np.eye(control_points), _DEGREE)
    total = np.zeros((control_points, control_points))
    for order, factor in ((1, velocity), (2, acceleration), (3, jerk)):
        values = curves(s, nu=order)
        total += factor * values.T @ (weight[:, None] * values)
    return total.astype(np.float32)


@cache
def fit(control_points: int, count: int) -> np.ndarray:
    """(control_points, count): the least-squares control points of `count` waypoints, ends
    exact."""
    full = basis(control_points, count).astype(float)
    ends = np.zeros((control_points, count))
    ends[0, 0] = ends[-1, -1] = 1.0
    inner = np.linalg.pinv(full[:, 1:-1]) @ (np.eye(count) - full @ ends)
    ends[1:-1] += inner
    return ends.astype(np.float32)


@cache
def natural_slopes(count: int) -> np.ndarray:
    """(count, count): slopes at `count` waypoints, one apart, of the natural cubic spline through
    them.

    Its second derivative is continuous, and zero at the ends.
    """
    left, right = np.zeros((count, count)), np.zeros((count, count))
    for i in range(1, count - 1):
        left[i, i - 1 : i + 2] = 1.0, 4.0, 1.0
        right[i, [i - 1, i + 1]] = -3.0, 3.0
    left[0, :2], right[0, :2] = (2.0, 1.0), (-3.0, 3.0)
    left[-1, -2:], right[-1, -2:] = (1.0, 2.0), (-3.0, 3.0)
    return np.linalg.solve(left, right).astype(np.float32)
