"""The Panda as a handful of solids, drawn after the outline of its real links, the fingers open."""

from functools import cache

import numpy as np

from drpbench.robot.solids import DARK, GREY, UPRIGHT, WHITE, Color, Point, Solid, ball

_HAND = 8  # the frame of hand and fingers


def _along(start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Quaternion wxyz that turns z into the direction from start to end."""
    x, y, z = (end - start) / np.linalg.norm(end - start)
    if z < -1.0 + 1e-9:
        return np.array([0.0, 1.0, 0.0, 0.0])
    return np.array([1.0 + z, -y, x, 0.0]) / np.sqrt(2.0 * (1.0 + z))


def _rod(frame: int, start: Point, end: Point, radius: float, color: Color) -> Solid:
    first, last = np.array(start, float), np.array(end, float)
    half = float(np.linalg.norm(last - first)) / 2
    return Solid(
        frame, "cylinder", (radius, radius, half), (first + last) / 2, _along(first, last), color
    )


def _bend(frame: int, points: list[Point], radius: float, color: Color) -> list[Solid]:
    """A round tube through the points."""
    rods = [_rod(frame, a, b, radius, color) for a, b in zip(points, points[1:], strict=False)]
    return rods + [ball(frame, point, radius, color) for point in points]


def _block(frame: int, center: Point, half_size: tuple[float, float, float], color: Color) -> Solid:
    return Solid(frame, "box", half_size, np.array(center, float), UPRIGHT, color)


@cache
def figure() -> tuple[Solid, ...]:
    """The solids of link0 to the fingers."""
    base = [
        *_bend(0, [(0, 0, 0.06), (-0.09, 0, 0.05)], 0.065, WHITE),
        _block(0, (-0.05, 0, 0.02), (0.1, 0.08, 0.02), WHITE),
        _rod(0, (0, 0, 0), (0, 0, 0.135), 0.06, WHITE),
        _rod(0, (0, 0, 0.135), (0, 0, 0.142), 0.052, DARK),
    ]
    link1 = [
        _rod(1, (0, 0, -0.19), (0, 0, -0.13), 0.055, WHITE),
        *_bend(1, [(0, -0.004, -0.14), (0, -0.045, -0.07), (0, -0.07, -0.005)], 0.056, WHITE),
        _rod(1, (0, -0.12, 0), (0, 0, 0), 0.055, WHITE),
        _rod(1, (0, -0.127, 0), (0, -0.12, 0), 0.045, DARK),
    ]
    link2 = [
        _rod(2, (0, 0, 0.004), (0, 0, 0.118), 0.055, WHITE),
        _rod(2, (0, 0, -0.002), (0, 0, 0.004), 0.052, DARK),
        _rod(2, (0, 0, 0.118), (0, 0, 0.125), 0.045, DARK),
        *_bend(2, [(0, -0.005, 0.07), (0, -0.07, 0.045), (0, -0.14, 0.004)], 0.056, WHITE),
        _rod(2, (0, -0.192, 0), (0, -0.13, 0), 0.055, WHITE),
    ]
    link3 = [
        _rod(3, (0, 0, -0.121), (0, 0, -0.114), 0.050, DARK),
        _rod(3, (0, 0, -0.114), (0, 0, -0.07), 0.053, WHITE),
        *_bend(3, [(0.002, 0.002, -0.075), (0.045, 0.03, -0.035), (0.08, 0.05, 0)], 0.054, WHITE),
        _rod(3, (0.0825, 0.002, 0), (0.0825, 0.102, 0), 0.052, WHITE),
        _rod(3, (0.0825, 0.102, 0), (0.0825, 0.109, 0), 0.043, DARK),
    ]
    link4 = [
        _rod(4, (0, 0, -0.002), (0, 0, 0.004), 0.050, DARK),
        _rod(4, (0, 0, 0.004), (0, 0, 0.102), 0.052, WHITE),
        _rod(4, (0, 0, 0.102), (0, 0, 0.109), 0.043, DARK),
        *_bend(4, [(0, 0, 0.05), (-0.04, 0.04, 0.03), (-0.08, 0.075, 0)], 0.054, WHITE),
        _rod(4, (-0.0825, 0.07, 0), (-0.0825, 0.124, 0), 0.053, WHITE),
    ]
    link5 = [
        _rod(5, (0, 0, -0.259), (0, 0, -0.252), 0.048, DARK),
        _rod(5, (0, 0, -0.252), (0, 0, -0.2), 0.050, WHITE),
        *_bend(5, [(0, 0.004, -0.21), (0, 0.045, -0.12), (0, 0.072, -0.015)], 0.046, WHITE),
        _rod(5, (0, 0, 0), (0, 0.12, 0), 0.049, WHITE),
        _rod(5, (0, 0.12, 0), (0, 0.126, 0), 0.040, DARK),
    ]
    link6 = [
        _rod(6, (0, 0, -0.002), (0, 0, 0.004), 0.047, DARK),
        *_bend(6, [(0, 0, 0.008), (0.088, 0.01, 0)], 0.048, WHITE),
        _rod(6, (0.088, -0.05, 0), (0.088, 0.04, 0), 0.045, WHITE),
        _rod(6, (0.088, 0.04, 0), (0.088, 0.072, 0), 0.035, WHITE),
    ]
    link7 = [
        _rod(7, (0, 0, 0.05), (0, 0, 0.057), 0.040, DARK),
        _rod(7, (0, 0, 0.057), (0, 0, 0.1), 0.042, WHITE),
        *_bend(7, [(0, 0, 0.08), (0.045, 0.045, 0.082)], 0.025, WHITE),
        _rod(7, (0, 0, 0.1), (0, 0, 0.108), 0.032, GREY),
    ]
    hand = [
        _block(_HAND, (0, 0, 0.028), (0.026, 0.078, 0.033), WHITE),
        *(_rod(_HAND, (0, y, -0.005), (0, y, 0.061), 0.026, WHITE) for y in (-0.076, 0.076)),
        _block(_HAND, (0, 0, 0.062), (0.018, 0.094, 0.004), DARK),
    ]
    for side in (-1, 1):
        hand += [
            _block(_HAND, (0, side * 0.052, 0.074), (0.0105, 0.012, 0.014), GREY),
            _block(_HAND, (0, side * 0.0465, 0.096), (0.009, 0.0065, 0.016), GREY),
        ]
    return (*base, *link1, *link2, *link3, *link4, *link5, *link6, *link7, *hand)
