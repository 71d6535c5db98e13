"""Points fixed to an arm: its collision spheres, and points on its surface."""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from drpbench.compile import stored

from .link_poses import LinkPoses


@dataclass(frozen=True)
class Link:
    """A body of the arm that can touch: the frame it is rigid in, and its own place in that frame.

    A point p of the link is at `offset` + `rotation` p [m] in the frame.
    """

    name: str
    frame: int
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)
    rotation: tuple[tuple[float, float, float], ...] = ((1, 0, 0), (0, 1, 0), (0, 0, 1))

    def in_frame(self, points: np.ndarray) -> np.ndarray:
        """Points (n, 3) of the link, moved into its frame [m]."""
        return points @ np.asarray(self.rotation, float).T + np.asarray(self.offset)


@dataclass(frozen=True)
class BodyPoints:
    """Points fixed to the arm, sorted by frame (0 the base, 1 to J the joints' links, J + 1 the
    hand).

    `link` indexes the robot's links; `local` is in the frame [m]; `radius` [m], zero for surface
    points.
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


def read_points(path: Path, links: Sequence[Link]) -> BodyPoints:
    """Points from a JSON file of rows by link's name: x, y, z in the link [m], and a sphere's
    radius [m]."""
    by_link = json.loads(path.read_text())
    frame: list[int] = []
    link: list[int] = []
    locals_, radii = [], []
    for index, body in enumerate(links):
        values = np.asarray(by_link.get(body.name, []), dtype=float)
        if values.size == 0:
            continue
        frame += [body.frame] * len(values)
        link += [index] * len(values)
        locals_.append(body.in_frame(values[:, :3]))
        radii.append(values[:, 3] if values.shape[1] == 4 else np.zeros(len(values)))
    local, radius = np.concatenate(locals_), np.concatenate(radii)
    return BodyPoints(
        np.array(frame), np.array(link), local.astype(np.float32), radius.astype(np.float32)
    )
