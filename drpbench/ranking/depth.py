"""Success where contacts of some depth are allowed.

The verdict counts every contact, however light. The evaluator counts those of more than 1 N.
"""

from collections.abc import Iterable, Sequence

import numpy as np

from drpbench.results import Row

LIGHT_DEPTH = 5e-5
"""[m] How deep a contact of 1 N at rest is, with the world's stiffness of 20 kN/m."""


def successes_by_depth(rows: Iterable[Row], depths: Sequence[float] | np.ndarray) -> np.ndarray:
    """How many of `rows` reached and were never deeper in an obstacle than each of `depths` [m]
    (D,): integers (D,). At depth 0 it is the verdict."""
    deepest = [
        0.0 if not row.collided else max(0.0, -(row.min_clearance or 0.0))
        for row in rows
        if row.reached
    ]
    return np.searchsorted(np.sort(deepest), np.asarray(depths, float), side="right")
