"""How far the arm moves at most between two configurations, and straight joint-space motions."""

from __future__ import annotations

import numpy as np

from drpbench.robot import PANDA


def bound(a: np.ndarray, b: np.ndarray) -> float:
    """Metres that no point of the arm exceeds on the joint-space line from `a` (7,) to `b` (7,)."""
    return float(PANDA.lever @ np.abs(b - a))


def line(a: np.ndarray, b: np.ndarray, resolution: float) -> np.ndarray:
    """Samples (m, 7) from `a` (left out) to `b`, with no point moving over `resolution` [m] between."""
    count = max(1, int(np.ceil(bound(a, b) / resolution)))
    return a + (b - a) * (np.arange(1, count + 1) / count)[:, None]


def samples(waypoints: np.ndarray, resolution: float) -> np.ndarray:
    """Samples (m, 7) along the whole polyline `waypoints` (k, 7), its first point included."""
    pieces = [waypoints[:1]]
    pieces += [line(a, b, resolution) for a, b in zip(waypoints[:-1], waypoints[1:], strict=True)]
    return np.concatenate(pieces)
