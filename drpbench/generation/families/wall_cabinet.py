"""A wall cabinet: mounted high on a panel of wall, its two doors open, glasses and bowls inside."""

from __future__ import annotations

import numpy as np

from drpbench.generation import scene
from drpbench.generation.families import placement
from drpbench.geometry import host_rotation as rotation

FORWARD = np.array([1.0, 0.0, 0.0])


def build(
    rng: np.random.Generator, items: int = 5, compact: bool = False, counter: int = 2
) -> scene.Furniture:
    """The cabinet, the wall behind it, up to `items` objects in it and `counter` pots below it."""
    width = rng.uniform(0.46, 0.52) if compact else rng.uniform(0.56, 0.76)
    depth, mount = rng.uniform(0.24, 0.30), rng.uniform(0.38, 0.48)
    room = rng.uniform(0.21, 0.25)
    wall, half = rng.uniform(0.012, 0.02), width / 2
    top = mount + 2 * room + 2 * wall
    parts = [
        scene.span((0, -half, mount), (depth, half, mount + wall)),
        scene.span((0, -half, mount + room), (depth, half, mount + room + wall)),
        scene.span((0, -half, top - wall), (depth, half, top)),
        scene.span((0, half - wall, mount), (depth, half, top)),
        scene.span((0, -half, mount), (depth, -half + wall, top)),
        scene.span((depth, -half - 0.15, 0), (depth + 0.03, half + 0.15, top + 0.08)),
    ]
    for side in (1, -1):
        opening = rng.uniform(np.radians(85), np.radians(140))
        outward = np.array([-np.sin(opening), -side * np.cos(opening), 0.0])
        hinge = np.array([-0.008, side * half, (mount + top) / 2])
        turn = rotation.axis_angle((0, 0, 1), -side * opening)
        parts.append(scene.box((0.016, half, top - mount), hinge + outward * half / 2, turn))
        # The handle stands on the outer face, near the free edge and low.
        face = np.array([np.cos(opening), -side * np.sin(opening), 0.0])
        grasp = hinge + outward * (half - 0.03) - 0.028 * face
        grasp[2] = mount + 0.12
        parts.append(scene.bar(0.007, grasp - (0, 0, 0.05), grasp + (0, 0, 0.05)))
    tight, objects = [], []
    for level in range(2):
        floor = mount + wall + level * room
        head = room - wall
        places = placement.slots(rng, -half + wall, half - wall, 2 if compact else 4)
        hands = set(rng.choice(len(places), 1 if compact else 2, replace=False).tolist())
        for index, (y, share) in enumerate(places):
            if index in hands:
                tight.append(
                    scene.region(
                        f"level {level}",
                        (-0.03, y - 0.03, floor + 0.3 * head),
                        (0.55 * depth, y + 0.03, floor + 0.7 * head),
                        FORWARD,
                        wide=placement.ACROSS,
                        tilt=0.3,
                        roll=np.pi,
                    )
                )
            elif rng.uniform() < 0.8:
                x = rng.uniform(0.5, 0.65) * depth
                objects.append(
                    placement.item(rng, x, y, floor, min(0.8 * share, 0.11), 0.75 * head)
                )
    parts += objects[:items]
    for y, share in placement.slots(rng, -half, half, max(counter, 1))[:counter]:
        across = min(rng.uniform(0.10, 0.18), 0.8 * share)
        tall = rng.uniform(0.08, 0.2)
        parts.append(scene.cylinder(across / 2, tall, (0.5 * depth, y, tall / 2)))
    return scene.Furniture(tuple(parts), tuple(tight), np.array([depth, width, top]))


def draw(rng: np.random.Generator) -> scene.Scene:
    """One wall cabinet before the arm, over the tabletop."""
    piece = build(rng)
    position, yaw = placement.pose(rng, (0.44, 0.56), (-0.6, 0.6), swivel=0.1)
    free = tuple(r for r in placement.around(piece.size, position, yaw) if r.place != "above")
    return scene.compose("wall_cabinet", (piece.placed(position, yaw),), free)
