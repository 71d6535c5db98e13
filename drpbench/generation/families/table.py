"""The bare table: nothing but the tabletop under the arm."""

from __future__ import annotations

import numpy as np

from drpbench.generation import scene
from drpbench.generation.families import placement
from drpbench.geometry import host_rotation as rotation


def draw(rng: np.random.Generator) -> scene.Scene:
    """The tabletop with open space to the arm's left, before it and to its right."""
    regions = []
    for place, bearing in (("left", 0.95), ("before", 0.0), ("right", -0.95)):
        turn = rotation.axis_angle((0, 0, 1), bearing + rng.uniform(-0.3, 0.3))
        open_space = scene.region(
            place,
            (0.35, -0.15, 0.10),
            (0.65, 0.15, 0.60),
            approach=placement.FORWARD_DOWN,
            wide=placement.ACROSS,
            tilt=np.pi / 3,
            roll=np.pi,
        )
        regions.append(scene.moved(open_space, np.zeros(3), turn))
    return scene.compose("table", (), tuple(regions))
