"""The scene families: each draws a `Scene` of primitives from a random generator."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from drpbench.generation.families import (
    box,
    cage,
    cubby,
    dishwasher,
    hybrid,
    microwave,
    shelf,
    table,
    wall_cabinet,
)

from ..scene import Scene

FAMILIES: dict[str, Callable[[np.random.Generator], Scene]] = {
    "box": box.draw,
    "cage": cage.draw,
    "cubby": cubby.draw,
    "dishwasher": dishwasher.draw,
    "hybrid": hybrid.draw,
    "microwave": microwave.draw,
    "shelf": shelf.draw,
    "wall_cabinet": wall_cabinet.draw,
    "table": table.draw,
}
"""Name to generator, in the order of the benchmark; the bare table comes last."""

FURNISHED = tuple(name for name in FAMILIES if name != "table")
"""The eight families of the static task."""
