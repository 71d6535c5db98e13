"""The static scene of a problem with pieces that can be moved, boxes that can be added, and its
points."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np

from drpbench.compile import jit
from drpbench.contract import Problem
from drpbench.envs import State
from drpbench.geometry import Obstacles, Primitives, concatenate, sample_surface
from drpbench.perception.surface_cloud import on_box

SPARE = 3
"""Boxes that can be added to a scene; the compiled world has room for so many."""
SHARE = 1 / 6
"""Of the static scene's points, what an added box takes: it is seen about as densely as a task's
own boxes."""
_TABLE = 1e-3  # [m] what does not rise above it is the ground things stand on


def with_room(problem: Problem) -> Problem:
    """The problem of one world, with SPARE primitives more that are not there."""
    both = concatenate(problem.obstacles, Obstacles.absent(SPARE).primitives())
    return replace(problem, obstacles=jax.tree.map(np.asarray, both))


_sampled = jit(sample_surface, static_argnums=2)


class Furniture:
    """The pieces of a scene, K with the spare ones last. A piece keeps its points wherever it is
    put."""

    def __init__(self, state: State, key: jax.Array):
        """`state` is what `World.reset` made of a problem `with_room` and `key`."""
        obstacles = jax.tree.map(np.array, state.problem.obstacles)
        self.kind, self.rotation = obstacles.kind, obstacles.rotation
        self.half_size, self.position = obstacles.half_size, obstacles.position
        self.present = obstacles.mask
        self._born = obstacles.position.copy()
        self._points = np.array(state.cloud.static_points)
        self._seen = np.array(state.cloud.static_mask)
        self._piece = piece_of_points(key, state.problem.obstacles, len(self._points))
        # Which points lie on added boxes, and where: drawn once, so that they stay what they are.
        random = np.random.default_rng(0)
        self._turn = random.random(len(self._points))
        self._tickets = random.random((len(self._points), 3), np.float32)

    @property
    def movable(self) -> np.ndarray:
        """(K,) bool: pieces that are there and rise above the ground."""
        top = self.position[:, 2] + self.half_size[:, 2]
        return self.present & (top > _TABLE)

    @property
    def added(self) -> range:
        """Indices of the spare pieces."""
        return range(len(self.present) - SPARE, len(self.present))

    def add(self, half_size: np.ndarray, position: np.ndarray) -> int | None:
        """An upright box more: its index, or None where there is no room for another."""
        free = [i for i in self.added if not self.present[i]]
        if not free:
            return None
        self.present[free[0]] = True
        self.half_size[free[0]], self.position[free[0]] = half_size, position
        return free[0]

    def remove_added(self) -> None:
        """Takes the added boxes away."""
        self.present[self.added.start :] = False

    def points(self) -> tuple[np.ndarray, np.ndarray]:
        """The static scene's points (N, 3) [m] where the pieces are, and which are seen (N,).

        Those of a piece move with it. Added boxes take their SHARE of the others, and give them
        back. What is below z = 0 is not seen.
        """
        shift = (self.position - self._born)[self._piece]
        points, seen = self._points + shift, self._seen.copy()
        seen &= (shift == 0.0).all(axis=1) | (points[:, 2] >= 0.0)
        for place, index in enumerate(self.added):
            if self.present[index]:
                mine = (self._turn >= place * SHARE) & (self._turn < (place + 1) * SHARE)
                local = on_box(jnp.array(self._tickets[mine]), jnp.array(self.half_size[index]))
                points[mine] = np.asarray(local) + self.position[index]
                seen[mine] = points[mine, 2] >= 0.0
        return np.where(seen[:, None], points, 0.0).astype(np.float32), seen

    def primitives(self) -> Primitives:
        """The pieces as they stand."""
        return Primitives(
            kind=jnp.array(self.kind),
            half_size=jnp.array(self.half_size),
            position=jnp.array(self.position),
            rotation=jnp.array(self.rotation),
            mask=jnp.array(self.present),
        )

    def put_into(self, state: State) -> State:
        """The state with the pieces and their points as they are now."""
        points, seen = self.points()
        return replace(
            state,
            problem=replace(state.problem, obstacles=self.primitives()),
            cloud=replace(
                state.cloud, static_points=jnp.array(points), static_mask=jnp.array(seen)
            ),
        )


def piece_of_points(key: jax.Array, obstacles: Primitives, count: int) -> np.ndarray:
    """The piece (N,) that each static scene point of a world lies on; `key` is the world's.

    `World.reset` and `sample_static` draw twice as many points, and keep the first of them above
    ground.
    """
    points, piece = _sampled(jax.random.split(key, 3)[1], obstacles, 2 * count)
    below = np.asarray(points)[:, 2] < -1e-6
    return np.asarray(piece)[np.argsort(below, kind="stable")[:count]]
