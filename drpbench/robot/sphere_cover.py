"""How well a set of collision spheres covers a link's mesh: largest gap, mean and max excess."""

from __future__ import annotations

import json
from dataclasses import dataclass

import numpy as np

from .link_meshes import LinkMesh
from .robot import Robot


@dataclass(frozen=True)
class CoverFigures:
    """Measured fit of one link's spheres. Lengths [m], area [m^2].

    `largest_gap`: how far a point of the mesh surface stands outside the sphere union, at most.
    `mean_excess`, `max_excess`: distance by which the union's exposed surface stands outside the
    mesh, over points uniform by area (points inside the mesh count as zero).
    `exposed_area`: area of that surface, the weight with which links are pooled.
    """

    largest_gap: float
    mean_excess: float
    max_excess: float
    exposed_area: float


def link_spheres(robot: Robot, link: str) -> np.ndarray:
    """The spheres (K, 4) of a link: centre in its own frame and radius [m]."""
    return np.array(json.loads((robot.folder / "spheres.json").read_text())[link])


def gap(spheres: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Signed distance (N,) of points (N, 3) to the union of spheres (K, 4), exact outside it."""
    result = np.full(len(points), np.inf)
    px, py, pz = np.ascontiguousarray(points.T)
    for x, y, z, radius in spheres:
        distance = np.sqrt((px - x) ** 2 + (py - y) ** 2 + (pz - z) ** 2)
        np.minimum(result, distance - radius, out=result)
    return result


def exposed_points(
    spheres: np.ndarray, n: int, rng: np.random.Generator
) -> tuple[np.ndarray, float]:
    """Points (M <= n, 3) uniform by area on the union's surface, and that surface's area."""
    radius = spheres[:, 3]
    owner = rng.choice(len(spheres), size=n, p=radius**2 / (radius**2).sum())
    direction = rng.standard_normal((n, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    points = spheres[owner, :3] + radius[owner, None] * direction
    exposed = gap(spheres, points) > -1e-9
    area = 4.0 * np.pi * (radius**2).sum() * exposed.mean()
    return points[exposed], float(area)


def largest_gap(mesh: LinkMesh, spheres: np.ndarray, n: int, rng: np.random.Generator) -> float:
    """Largest `gap` [m] over the mesh surface: n points and the vertices, then uphill.

    The gap peaks sharply where spheres meet, between any fixed points; so the worst are moved at
    random along the surface, by less and less, and the worst kept.
    """
    points = np.concatenate([mesh.sample_surface(n, rng), mesh.outer_vertices()])
    for step in (5e-4, 2e-4, 1e-4, 5e-5):
        points = points[np.argsort(-gap(spheres, points))[:300]]
        moved = np.repeat(points, 6, axis=0)
        moved = mesh.closest_points(moved + step * rng.standard_normal(moved.shape))
        points = np.concatenate([points, moved])
    return float(gap(spheres, points).max())


def measure_cover(mesh: LinkMesh, spheres: np.ndarray, n: int, seed: int) -> CoverFigures:
    """Figures from n surface points of the mesh (and its vertices) and n of the spheres."""
    rng = np.random.default_rng(seed)
    points, area = exposed_points(spheres, n, rng)
    excess = np.maximum(0.0, mesh.signed_distance(points))
    return CoverFigures(
        largest_gap=largest_gap(mesh, spheres, n, rng),
        mean_excess=float(excess.mean()),
        max_excess=float(excess.max()),
        exposed_area=area,
    )


def pooled_mean_excess(figures: list[CoverFigures]) -> float:
    """Mean excess [m] over the exposed surface of several links together."""
    area = np.array([f.exposed_area for f in figures])
    return float(area @ [f.mean_excess for f in figures] / area.sum())


def farthest_points(points: np.ndarray, n: int) -> np.ndarray:
    """Indices (n,) of a greedy farthest-point sample; every prefix is well spread.

    Gonzalez, "Clustering to minimize the maximum intercluster distance", 1985.
    """
    if n > len(points):
        raise ValueError(f"cannot pick {n} of {len(points)} points")
    # Starting at an extremity rather than at the first point keeps the result independent of
    # the order of the input.
    centre = points.mean(axis=0)
    chosen = [int(np.argmax(((points - centre) ** 2).sum(axis=1)))]
    distance = ((points - points[chosen[0]]) ** 2).sum(axis=1)
    while len(chosen) < n:
        chosen.append(int(distance.argmax()))
        np.minimum(distance, ((points - points[chosen[-1]]) ** 2).sum(axis=1), out=distance)
    return np.array(chosen)
