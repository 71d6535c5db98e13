"""The arm as spheres: the collision model of the verdict, of contact, and of every planner.

The spheres cover the real collision meshes (`scripts/fit_spheres.py`, figures in docs/architecture.md).
"""

import json
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from drpbench.compile import stored

from .arms.panda import FINGER_HEIGHT, FINGER_OPENING, LINKS
from .kinematics import LinkPoses

# Links that can touch, as frames: every one of the first group against every one of the second.
# Over random configurations no other pair that is at least two links apart ever does, neither the
# spheres nor the real meshes; but for the spheres of link5 and link7, whose meshes stay apart.
SELF_COLLISION_BLOCKS = (((0, 1, 2), (5, 6, 7, 8)), ((5,), (8,)))


@dataclass(frozen=True)
class BodyPoints:
    """Points fixed to the arm, sorted by frame (0..7 link0 to link7, 8 hand and fingers).

    `link` indexes `LINKS`; `local` is in the frame [m]; `radius` [m], zero for surface points.
    """

    frame: np.ndarray  # (S,) int
    link: np.ndarray  # (S,) int
    local: np.ndarray  # (S, 3)
    radius: np.ndarray  # (S,)

    @property
    def count(self) -> int:
        return len(self.frame)

    def part(self, keep: np.ndarray) -> "BodyPoints":
        """Those that a boolean mask or an index array picks, in their order."""
        return BodyPoints(self.frame[keep], self.link[keep], self.local[keep], self.radius[keep])

    @property
    def frames(self) -> np.ndarray:
        """The frames that carry points, in order (F,)."""
        return np.unique(self.frame)

    def closest(self, distance: Float[Array, " S"]) -> Int[Array, " F"]:
        """Index of the point with the least distance, for each of `frames`."""
        groups = [np.nonzero(self.frame == frame)[0] for frame in self.frames]
        return jnp.stack(
            [jnp.argmin(distance[group[0] : group[-1] + 1]) + int(group[0]) for group in groups]
        )

    def world(self, poses: LinkPoses) -> Float[Array, "S 3"]:
        """World positions [m] at the given link poses."""
        pieces = []
        for frame in self.frames:
            local = self.local[self.frame == frame]
            r, p = poses.rotation[frame], poses.position[frame]
            pieces.append(
                jnp.stack(
                    [
                        p[i] + r[i, 0] * local[:, 0] + r[i, 1] * local[:, 1] + r[i, 2] * local[:, 2]
                        for i in range(3)
                    ],
                    axis=-1,
                )
            )
        return stored(jnp.concatenate(pieces))


def _in_frame(link: str, points: np.ndarray) -> np.ndarray:
    """Finger coordinates moved into the hand frame; every other link's are its frame's already."""
    if link == "left_finger":
        return points + [0.0, FINGER_OPENING, FINGER_HEIGHT]
    if link == "right_finger":
        return points * [-1.0, -1.0, 1.0] + [0.0, -FINGER_OPENING, FINGER_HEIGHT]
    return points


def _read(name: str) -> BodyPoints:
    """Points by link from one of the arm's JSON files."""
    by_link = json.loads((Path(__file__).parent / name).read_text())
    frame, link, local, radius = [], [], [], []
    for index, link_name in enumerate(LINKS):
        values = np.asarray(by_link.get(link_name, []), dtype=float)
        if values.size == 0:
            continue
        frame += [min(index, 8)] * len(values)
        link += [index] * len(values)
        local.append(_in_frame(link_name, values[:, :3]))
        radius.append(values[:, 3] if values.shape[1] == 4 else np.zeros(len(values)))
    local, radius = np.concatenate(local), np.concatenate(radius)
    return BodyPoints(
        np.array(frame), np.array(link), local.astype(np.float32), radius.astype(np.float32)
    )


@cache
def spheres() -> BodyPoints:
    """All collision spheres of the arm, link0 included."""
    return _read("arms/panda/spheres.json")


@cache
def moving_spheres() -> BodyPoints:
    """The spheres that a policy answers for: all but the immovable link0's."""
    return spheres().part(spheres().link > 0)


@cache
def surface_points(count: int | None = None) -> BodyPoints:
    """Points on the outer surface of the real meshes, link1 to the fingers; `count` of them, evenly
    chosen, or all."""
    points = _read("arms/panda/surface.json")
    if count is None:
        return points
    return points.part(np.linspace(0, points.count - 1, count).round().astype(int))


def self_clearance(poses: LinkPoses) -> Float[Array, ""]:
    """Smallest distance [m] between spheres of two links that can touch; negative in self-collision."""
    model = spheres()
    points = model.world(poses)
    clearance = jnp.float32(1.0e6)
    for first, second in SELF_COLLISION_BLOCKS:
        a, b = np.isin(model.frame, first), np.isin(model.frame, second)
        others, p, r = points[a], points[b], model.radius[b]

        def visit(nearest, sphere, p=p, r=r):
            x, y, z, radius = sphere
            dx, dy, dz = p[:, 0] - x, p[:, 1] - y, p[:, 2] - z
            gap = jnp.sqrt(dx * dx + dy * dy + dz * dz) - (r + radius)
            # jnp.minimum looks for NaN in both, at twice the cost.
            return jnp.where(gap > nearest, nearest, gap), None

        rows = (others[:, 0], others[:, 1], others[:, 2], jnp.asarray(model.radius[a]))
        nearest, _ = jax.lax.scan(visit, jnp.full(len(r), 1.0e6), rows, unroll=True)
        clearance = jnp.minimum(clearance, jnp.min(stored(nearest)))
    return clearance
