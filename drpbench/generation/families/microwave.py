"""A microwave oven with its door open: a cavity with a turntable, a control panel, a handle."""

from __future__ import annotations

import numpy as np

from drpbench.generation import scene
from drpbench.generation.families import placement
from drpbench.geometry import host_rotation as rotation

FORWARD = np.array([1.0, 0.0, 0.0])


def build(rng: np.random.Generator, items: int = 1, compact: bool = False) -> scene.Furniture:
    """The oven on its stand. The door is hinged on the left edge and open by 95 to 150 degrees."""
    width = rng.uniform(0.46, 0.50 if compact else 0.58)
    depth, height = rng.uniform(0.32, 0.40), rng.uniform(0.28, 0.35)
    panel, wall = rng.uniform(0.09, 0.12), rng.uniform(0.012, 0.02)
    stand = 0.0 if rng.uniform() < 0.35 else rng.uniform(0.05, 0.30)
    half, right = width / 2, -width / 2 + panel  # the cavity lies between y = right and half - wall
    bottom, top = stand + wall, stand + height - wall
    parts = [
        scene.span((0, -half, stand), (depth, half, bottom)),
        scene.span((0, -half, top), (depth, half, stand + height)),
        scene.span((0, half - wall, bottom), (depth, half, top)),
        scene.span((0, -half, bottom), (depth, right, top)),
        scene.span((depth - wall, right, bottom), (depth, half - wall, top)),
    ]
    opening = rng.uniform(np.radians(95), np.radians(150))
    leaf = half - right
    # Closed, the door reaches from its hinge at y = half to y = right; opening turns it to the
    # front.
    outward = np.array([-np.sin(opening), -np.cos(opening), 0.0])
    middle = np.array([-0.012, half, stand + height / 2]) + outward * leaf / 2
    parts.append(scene.box((0.024, leaf, height), middle, rotation.axis_angle((0, 0, 1), -opening)))
    grasp = np.array([-0.012, half, 0.0]) + outward * (leaf - 0.03)
    face = np.array([np.cos(opening), -np.sin(opening), 0.0])  # the outer side of the door
    grasp = grasp - 0.03 * face
    parts.append(
        scene.bar(0.009, (*grasp[:2], stand + 0.2 * height), (*grasp[:2], stand + 0.8 * height))
    )
    for z in (0.35, 0.65):
        knob = (-0.008, -half + panel / 2, stand + z * height)
        parts.append(scene.cylinder(0.022, 0.02, knob, scene.AXIS_X))
    centre = (half - wall + right) / 2
    parts.append(scene.cylinder(0.13, 0.012, (depth / 2 - 0.005, centre, bottom + 0.012)))
    if stand:
        parts.append(scene.span((0.02, -half + 0.03, 0), (depth, half - 0.03, stand)))
    floor = bottom + 0.03
    if items and rng.uniform() < 0.6:
        parts.append(
            scene.cylinder(
                rng.uniform(0.035, 0.05), 0.09, (0.68 * depth, centre + 0.05, bottom + 0.065)
            )
        )
    inside = scene.region(
        "in the microwave",
        (0.0, centre - 0.05, floor + 0.05),
        (0.5 * depth, centre + 0.05, top - 0.07),
        FORWARD,
        wide=placement.ACROSS,
        tilt=0.3,
        roll=np.pi,
    )
    at_handle = scene.region(
        "at the handle",
        (grasp[0] - 0.01, grasp[1] - 0.01, stand + 0.35 * height),
        (grasp[0] + 0.01, grasp[1] + 0.01, stand + 0.65 * height),
        face,
        wide=outward,
        tilt=0.3,
        roll=0.2,
    )
    on_top = scene.region(
        "on the microwave",
        (0.2 * depth, -0.4 * width, stand + height + 0.03),
        (0.8 * depth, 0.4 * width, stand + height + 0.06),
        (0.5, 0, -1),
        wide=placement.ACROSS,
        tilt=0.4,
        roll=np.pi,
    )
    return scene.Furniture(
        tuple(parts),
        (inside, inside, inside, at_handle, on_top),
        np.array([depth, width, stand + height]),
    )


def draw(rng: np.random.Generator) -> scene.Scene:
    """One microwave before the arm."""
    piece = build(rng)
    position, yaw = placement.pose(rng, (0.42, 0.55), (-0.8, 0.6))
    return scene.compose(
        "microwave", (piece.placed(position, yaw),), placement.around(piece.size, position, yaw)
    )
