"""RRT-Connect (Kuffner and LaValle, 2000) in joint space, and random shortcutting of its paths."""

from __future__ import annotations

import numpy as np

from drpbench.robot import Robot

from . import motion
from .checker import Checker
from .joint_limits import inner_limits

FINE = 0.01  # [m] of motion between checks near obstacles
COARSE = 0.04  # [m] of motion between checks in the open
_SPACING = 0.35  # [m] of motion between the nodes of a tree


class Planner:
    """Joint-space paths that keep `clearance` [m] from one checker's scene.

    A motion is checked in steps as long as the clearance at the last step allows (nothing can come
    closer than the arm moves), between `FINE` and `COARSE`. Effort is counted in checks and not in
    seconds, so that a plan does not depend on the machine.
    """

    def __init__(self, checker: Checker, clearance: float):
        self._checker, self._clearance, self._robot = checker, clearance, checker.robot
        self.checks = 0
        """Configurations checked so far."""

    def _bound(self, a: np.ndarray, b: np.ndarray) -> float:
        return motion.bound(a, b, self._robot)

    def _walk(self, a: np.ndarray, b: np.ndarray) -> float:
        """Share of the line from `a` (free) to `b` that can be walked; 1 is all of it."""
        length = self._bound(a, b)
        if length == 0:
            return 1.0
        travelled, step = 0.0, FINE
        while travelled < length:
            ahead = min(travelled + step, length)
            self.checks += 1
            spare = self._checker.clearance(a + (b - a) * (ahead / length)) - self._clearance
            if spare <= 0:
                return travelled / length
            travelled, step = ahead, min(max(spare, FINE), COARSE)
        return 1.0

    def straight(self, a: np.ndarray, b: np.ndarray) -> bool:
        """Whether the line from `a` to `b` is free from end to end."""
        return self._walk(a, b) == 1.0

    def plan(
        self, rng: np.random.Generator, start: np.ndarray, goal: np.ndarray, max_checks: int
    ) -> np.ndarray | None:
        """Waypoints (k, J) from `start` to `goal`, or None after `max_checks` checks."""
        first_check = self.checks
        if self.straight(start, goal):
            return np.stack([start, goal])
        here, there = _Tree(start, self._robot), _Tree(goal, self._robot)
        lower, upper = inner_limits(self._robot)
        while self.checks - first_check < max_checks:
            if rng.uniform() < 0.5:
                target = rng.uniform(lower, upper)
            else:  # near the line between the two: most detours are not far
                target = (
                    start + rng.uniform() * (goal - start) + rng.normal(0, 0.8, self._robot.joints)
                )
                target = np.clip(target, lower, upper)
            node = self._grow(here, target, reach=2 * _SPACING)
            if node is not None:
                meeting = self._grow(there, here.points[node], reach=np.inf)
                if meeting is not None and np.array_equal(there.points[meeting], here.points[node]):
                    path = here.path(node)[::-1] + there.path(meeting)[1:]
                    path = path if np.array_equal(path[0], start) else path[::-1]
                    return np.stack(path)
            here, there = there, here
        return None

    def _grow(self, tree: _Tree, target: np.ndarray, reach: float) -> int | None:
        """Walks from the nearest node towards `target`, at most `reach` [m]; the last node
        added."""
        index = tree.nearest(target)
        origin = tree.points[index]
        length = self._bound(origin, target)
        goal = target if length <= reach else origin + (target - origin) * (reach / length)
        share = self._walk(origin, goal)
        end = goal if share == 1.0 else origin + (goal - origin) * share
        walked = self._bound(origin, end)
        if walked < FINE:
            return index if length < FINE and share == 1.0 else None
        count = int(np.ceil(walked / _SPACING))
        for k in range(1, count + 1):
            point = end if k == count else origin + (end - origin) * (k / count)
            index = tree.add(point, index)
        return index

    def shortcut(self, rng: np.random.Generator, path: np.ndarray, tries: int) -> np.ndarray:
        """The path (k, J) with random stretches replaced by straight ones, where those are free."""
        points = list(path)
        for _ in range(tries):
            if len(points) == 2:
                break
            lengths = np.array(
                [self._bound(a, b) for a, b in zip(points[:-1], points[1:], strict=True)]
            )
            ends = np.concatenate([[0.0], np.cumsum(lengths)])
            s, t = np.sort(rng.uniform(0, ends[-1], 2))
            i, j = (
                min(int(np.searchsorted(ends, x, "right")) - 1, len(points) - 2) for x in (s, t)
            )
            if i == j:
                continue
            a = points[i] + (points[i + 1] - points[i]) * ((s - ends[i]) / lengths[i])
            b = points[j] + (points[j + 1] - points[j]) * ((t - ends[j]) / lengths[j])
            if self._bound(a, b) < 0.98 * (t - s) and self.straight(a, b):
                points[i + 1 : j + 1] = [a, b]
        return self._without_needless(np.stack(points))

    def _without_needless(self, path: np.ndarray) -> np.ndarray:
        """The path without those waypoints that can be skipped."""
        kept, index = [path[0]], 0
        while index < len(path) - 1:
            last = index + 1
            for candidate in range(min(len(path) - 1, index + 6), index + 1, -1):
                if self.straight(path[index], path[candidate]):
                    last = candidate
                    break
            kept.append(path[last])
            index = last
        return np.stack(kept)


class _Tree:
    """Configurations with their parents, in an array that doubles when it is full."""

    def __init__(self, root: np.ndarray, robot: Robot):
        self.points = np.empty((256, robot.joints))
        self.points[0] = root
        self._lever = robot.lever
        self._parents = [-1]

    def nearest(self, target: np.ndarray) -> int:
        # Joints weighed by their levers: near is what the arm reaches with little motion.
        offsets = (self.points[: len(self._parents)] - target) * self._lever
        return int(np.argmin(np.einsum("ij,ij->i", offsets, offsets)))

    def add(self, point: np.ndarray, parent: int) -> int:
        index = len(self._parents)
        if index == len(self.points):
            self.points = np.concatenate([self.points, np.empty_like(self.points)])
        self.points[index] = point
        self._parents.append(parent)
        return index

    def path(self, node: int) -> list[np.ndarray]:
        """From `node` to the root."""
        found = []
        while node >= 0:
            found.append(self.points[node].copy())
            node = self._parents[node]
        return found
