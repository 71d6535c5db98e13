"""Fits the Panda's collision spheres and surface points to its real collision meshes.

    python scripts/fit_spheres.py [FOLDER]

FOLDER holds panda_collision.xml or panda.xml and its assets; without it the meshes are looked for
where `PANDA.meshes.find` looks. Writes spheres.json and surface.json into
drpbench/robot/arms/panda. Deterministic on one machine: every random draw is seeded.

Three steps a link. A sphere centred at c may have radius E - sdf(c), where E is the excess the
link is allowed; so the fewest spheres are a minimum set cover of the mesh surface by such balls
(set_cover). From relaxed covers, gradient descent on centres and radii pulls every surface point
within the tolerance and then takes excess off (refine). What a dense sample still finds outside
is added to the constraints, and what is left in the end is paid for in radius (fit_link, sealed).
"""

from __future__ import annotations

import argparse
import json
import sys
from functools import partial
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

from drpbench.robot import PANDA
from drpbench.robot.link_meshes import LinkMesh, load_link_meshes
from drpbench.robot.sphere_cover import farthest_points, gap, largest_gap, measure_cover

ROBOT = Path(__file__).resolve().parents[1] / "drpbench" / "robot" / "arms" / "panda"

# Sphere count and the largest excess [mm] each link is fitted for: a hundred spheres in all, spent
# where obstacles come. At 15 mm (arm) and 6 mm (hand, fingers) these are about the fewest that this
# search reaches; link1 and link2 at the base get one fewer and end near 17 mm, and link0 meets
# nothing but the arm itself.
PLAN = {
    "link0": (12, 22.0),
    "link1": (9, 16.0),
    "link2": (9, 16.0),
    "link3": (8, 15.0),
    "link4": (8, 15.0),
    "link5": (15, 15.0),
    "link6": (8, 15.0),
    "link7": (6, 15.0),
    "hand": (19, 6.0),
    "left_finger": (9, 6.0),
}
TOLERANCE = 2.7  # mm the surface may stand outside the spheres; the promise is 3
SEAL = 2.9  # mm, the largest gap that the finished spheres may have
SURFACE_POINTS = 512
MM = 1e3


class Field:
    """Signed distance [mm] to a link's mesh on a grid, for gradients; trilinear in between."""

    def __init__(self, mesh: LinkMesh, spacing: float, margin: float):
        vertices = mesh.outer_vertices()
        low = vertices.min(axis=0) - margin
        shape = np.ceil((vertices.max(axis=0) + margin - low) / spacing).astype(int) + 1
        axes = [low[i] + spacing * np.arange(shape[i]) for i in range(3)]
        points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
        self.grid = jnp.asarray(MM * mesh.signed_distance(points).reshape(shape), jnp.float32)
        self.low = jnp.asarray(MM * low, jnp.float32)
        self.spacing = MM * spacing

    def args(self):
        return self.grid, self.low, self.spacing


def set_cover(covers: np.ndarray, target: int, iterations: int, rng) -> list[int]:
    """Rows chosen from covers (candidates, points) so that every point is covered.

    Weighting-based local search: Gao, Weise, Li, "An efficient local search heuristic with row
    weighting for the unicost set covering problem", EJOR 2015. Stops at `target` rows.
    """
    n_candidates, n_points = covers.shape
    coverers = [np.flatnonzero(covers[:, j]) for j in range(n_points)]
    if min(map(len, coverers)) == 0:
        raise ValueError("no candidate sphere covers some surface point: refine the grid")
    weight, count = np.ones(n_points), np.zeros(n_points, int)
    chosen: list[int] = []
    touched = np.zeros(n_candidates, int)
    open_ = np.ones(n_points, bool)
    while open_.any():
        gain = covers[:, open_].sum(axis=1)
        chosen.append(int(rng.choice(np.flatnonzero(gain == gain.max()))))
        open_ &= ~covers[chosen[-1]]
        count += covers[chosen[-1]]

    def cheapest() -> int:
        """Position in `chosen` whose loss uncovers the least weight, the longest untouched."""
        loss = (covers[chosen] * (count == 1) * weight).sum(axis=1)
        loss[np.array(chosen) == tabu] = np.inf
        ties = np.flatnonzero(loss == loss.min())
        return int(ties[touched[np.array(chosen)[ties]].argmin()])

    best, tabu = list(chosen), -1
    for step in range(iterations):
        while (count > 0).all():
            best = list(chosen)
            if len(best) <= target:
                return best
            tabu = -1
            count -= covers[chosen.pop(cheapest())]
        removed = chosen.pop(cheapest())
        count -= covers[removed]
        touched[removed] = step
        uncovered = np.flatnonzero(count == 0)
        options = coverers[rng.choice(uncovered)]
        gain = covers[np.ix_(options, uncovered)] @ weight[uncovered]
        gain[options == removed] = -1.0
        ties = options[gain >= gain.max() - 1e-9]
        added = int(ties[touched[ties].argmin()])
        if rng.random() < 0.2:
            added = int(rng.choice(ties))
        chosen.append(added)
        count += covers[added]
        touched[added], tabu = step, added
        weight[count == 0] += 1.0
    return best


def signed_distance(points, grid, low, spacing):
    """Trilinear interpolation of the field at points (..., 3) [mm]."""
    shape = np.array(grid.shape)
    position = jnp.clip((points - low) / spacing, 0.0, shape - 1.001)
    cell = jnp.floor(position).astype(int)
    fraction = position - cell
    flat = grid.reshape(-1)
    base = (cell[..., 0] * shape[1] + cell[..., 1]) * shape[2] + cell[..., 2]
    total = 0.0
    for corner in np.ndindex(2, 2, 2):
        offset = (corner[0] * shape[1] + corner[1]) * shape[2] + corner[2]
        share = 1.0
        for axis in range(3):
            share *= fraction[..., axis] if corner[axis] else 1.0 - fraction[..., axis]
        total += share * flat[base + offset]
    return total


def centre_distance(a, b):
    """(N, 3), (M, 3) -> (N, M), with a gradient at zero."""
    return jnp.sqrt(sum((a[:, None, i] - b[None, :, i]) ** 2 for i in range(3)) + 1e-6)


def adam(loss, x, steps: int, rate):
    """Adam (Kingma & Ba 2015) with a cosine rate; loss(x, progress in [0, 1))."""

    def step(state, t):
        x, mean, square = state
        g = jax.grad(loss)(x, t / steps)
        mean, square = 0.9 * mean + 0.1 * g, 0.99 * square + 0.01 * g * g
        lr = rate * (0.505 + 0.495 * jnp.cos(jnp.pi * t / steps))
        update = mean / (1.0 - 0.9 ** (t + 1)) / (jnp.sqrt(square / (1.0 - 0.99 ** (t + 1))) + 1e-8)
        return (x - lr * update, mean, square), None

    start = (x, jnp.zeros_like(x), jnp.zeros_like(x))
    return jax.lax.scan(step, start, jnp.arange(steps))[0][0]


def fibonacci_directions(n: int) -> np.ndarray:
    i = np.arange(n) + 0.5
    z, angle = 1.0 - 2.0 * i / n, np.pi * (1.0 + 5.0**0.5) * i
    s = np.sqrt(1.0 - z * z)
    return np.stack([s * np.cos(angle), s * np.sin(angle), z], axis=-1)


DIRECTIONS = jnp.asarray(fibonacci_directions(200), jnp.float32)


@partial(jax.jit, static_argnames="steps")
def cover_descent(centres, surface, field, limit, tolerance, steps: int):
    """Moves centres (S, N, 3), radii at their largest, until the surface is covered.

    Returns spheres (S, N, 4)."""

    def run(start):
        def loss(c, _):
            radius = limit - signed_distance(c, *field)
            miss = jnp.min(centre_distance(c, surface) - radius[:, None], axis=0) - tolerance
            return jnp.sum(jax.nn.relu(miss + 0.3) ** 2)

        c = adam(loss, start, steps, 2.0)
        return jnp.concatenate([c, (limit - signed_distance(c, *field))[:, None]], axis=1)

    return jax.lax.map(run, centres)


@partial(jax.jit, static_argnames="steps")
def excess_descent(spheres, surface, field, limit, tolerance, steps: int, rate, penalty_start):
    """Takes excess off spheres (S, N, 4) while they keep to coverage and to the excess limit.

    `surface` (S, P, 3): the points each set has to cover. The weight of both limits grows from
    `penalty_start` to 4 over the steps.
    Returns the spheres and each set's excess volume [mm^3]: the integral of the excess over the
    exposed surface."""
    n = spheres.shape[1]
    owner = np.repeat(np.arange(n), len(DIRECTIONS))
    own = jnp.asarray(owner[None] == np.arange(n)[:, None])

    def excess_volume(x):
        c, r = x[:, :3], x[:, 3]
        points = (c[:, None] + r[:, None, None] * DIRECTIONS).reshape(-1, 3)
        outside = jnp.where(own, jnp.inf, centre_distance(c, points) - r[:, None]).min(axis=0)
        exposed = jax.nn.sigmoid(outside / 0.5)  # 0.5 mm: smooth enough to have a gradient
        element = 4.0 * jnp.pi / len(DIRECTIONS) * r[owner] ** 2
        return jnp.sum(element * exposed * jax.nn.relu(signed_distance(points, *field)))

    def run(start):
        x, surface = start
        scale = 1.0 / jnp.sum(4.0 * jnp.pi * x[:, 3] ** 2)

        def loss(x, progress):
            c, r = x[:, :3], x[:, 3]
            miss = jnp.min(centre_distance(c, surface) - r[:, None], axis=0) - tolerance
            over = r + signed_distance(c, *field) - limit
            penalty = penalty_start ** (1.0 - progress) * 4.0**progress
            return (
                scale * excess_volume(x)
                + penalty * jnp.sum(jax.nn.relu(miss + 0.03) ** 2)
                + 5.0 * penalty * jnp.sum(jax.nn.relu(over) ** 2)
            )

        x = adam(loss, x, steps, rate)
        return x, excess_volume(x)

    return jax.lax.map(run, (spheres, surface))


def candidate_centres(mesh: LinkMesh, rng) -> tuple[np.ndarray, np.ndarray]:
    """Interior grid points (C, 3) [m] and their depth (C,): about 20,000."""
    low, high = mesh.outer_vertices().min(axis=0), mesh.outer_vertices().max(axis=0)
    volume = sum(part.volume for part in mesh.parts)
    spacing = (volume / 20_000) ** (1.0 / 3.0)
    axes = [
        np.arange(a + spacing * rng.random(), b, spacing) for a, b in zip(low, high, strict=True)
    ]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    points = points[mesh.inside(points)]
    return points, mesh.distance(points)


def relaxed_covers(mesh: LinkMesh, surface: np.ndarray, n: int, limit: float, starts: int, rng):
    """Centres (starts, n, 3) [mm] of covers by n balls, each at the least slack that admits it."""
    points, depth = candidate_centres(mesh, rng)
    reach = np.stack([np.linalg.norm(points - s, axis=1) for s in surface / MM], axis=1) * MM
    reach = (reach - MM * depth[:, None]).astype(np.float32) - limit
    covers = []
    slack = TOLERANCE
    while len(covers) < starts:
        chosen = set_cover(reach <= slack, n, 3000, rng)
        if len(chosen) > n:
            slack += 0.15
            continue
        extra = rng.choice(len(points), n - len(chosen), replace=False)
        covers.append(MM * points[np.concatenate([chosen, extra]).astype(int)])
    print(f"  covers at a slack of {slack:.2f} mm", flush=True)
    return np.stack(covers)


def fit_link(mesh: LinkMesh, n: int, limit: float, seed: int = 0, starts: int = 12) -> np.ndarray:
    """Spheres (n, 4) [m] with excess at most about `limit` [mm] and every point within 3 mm."""
    rng = np.random.default_rng(seed)
    thickness = min(np.ptp(mesh.outer_vertices(), axis=0))
    field = Field(mesh, spacing=min(0.004, thickness / 25.0), margin=2e-3 + 1.2e-3 * limit).args()
    dense = MM * np.concatenate([mesh.outer_vertices(), mesh.sample_surface(400_000, rng)])
    surface = dense[:50_000][farthest_points(dense[:50_000], 2500)]
    centres = relaxed_covers(mesh, surface[:1500], n, limit, starts, rng)
    spheres = cover_descent(
        jnp.asarray(centres, jnp.float32),
        jnp.asarray(surface, jnp.float32),
        field,
        limit,
        TOLERANCE,
        500,
    )
    # The deepest creases between spheres lie between the surface points: each round adds the
    # dense points that a start leaves outside, or nearly, and moves less, so that they stay the
    # deepest. Later rounds go on with the best starts only.
    constraint = np.repeat(surface[None], starts, axis=0)
    for steps, rate, penalty, kept in (
        (400, 0.7, 0.02, 8),
        (300, 0.3, 0.5, 5),
        (300, 0.2, 4.0, 3),
        (300, 0.1, 4.0, 3),
        (300, 0.05, 4.0, 3),
        (300, 0.03, 4.0, 1),
    ):
        worst = [dense[np.argpartition(-gap(s, dense), 800)[:800]] for s in np.asarray(spheres)]
        constraint = np.concatenate([constraint, worst], axis=1)
        spheres, volume = excess_descent(
            spheres,
            jnp.asarray(constraint, jnp.float32),
            field,
            limit,
            TOLERANCE,
            steps,
            rate,
            penalty,
        )
        miss = np.array([gap(x, dense).max() for x in np.asarray(spheres)])
        inflation = np.maximum(0.0, miss - (TOLERANCE + 0.05))
        depth = -np.asarray(signed_distance(spheres[..., :3], *field))
        top = np.max(np.asarray(spheres)[..., 3] - depth, axis=1) + inflation
        # A set over its limit loses against every set within it; 0.1 mm is the grid's error.
        over = np.maximum(0.0, top - limit - 0.1)
        order = np.lexsort((np.asarray(volume), over))[:kept]
        spheres, constraint = np.asarray(spheres)[order], constraint[order]
        over, inflation = over[order], inflation[order]
    over, best = over[0], spheres[0].astype(float)
    best[:, 3] += inflation[0]
    if over > 0.0:
        print(f"  excess is {over:.2f} mm over the limit of {limit:g} mm", flush=True)
    return best / MM


def rounded_up(spheres: np.ndarray) -> list[list[float]]:
    """Spheres as JSON rows to 0.01 mm, the radius up so that rounding uncovers nothing."""
    rows = []
    for x, y, z, r in spheres:
        rows.append([round(v, 5) for v in (x, y, z, np.ceil((r + 1e-5) * 1e5) / 1e5)])
    return sorted(rows, key=lambda row: -row[3])


def sealed(mesh: LinkMesh, rows: list[list[float]]) -> list[list[float]]:
    """The rows with every radius grown by what the largest gap, searched for, exceeds SEAL by."""
    spheres = np.array(rows)
    miss = largest_gap(mesh, spheres, 200_000, np.random.default_rng(2)) - SEAL / MM
    if miss <= 0.0:
        return rows
    spheres[:, 3] += miss
    return rounded_up(spheres)


def fit_surface(meshes: dict[str, LinkMesh], total: int) -> dict[str, np.ndarray]:
    """Well-spread points on each link's outer surface, shared out by area, `total` in all."""
    area = np.array([mesh.outer_area() for mesh in meshes.values()])
    share = total * area / area.sum()
    count = np.floor(share).astype(int)
    count[np.argsort(count - share)[: total - count.sum()]] += 1
    rng = np.random.default_rng(0)
    result = {}
    for (name, mesh), n in zip(meshes.items(), count, strict=True):
        points = mesh.sample_surface(100 * int(n), rng)
        result[name] = points[farthest_points(points, int(n))]
    return result


def write_rows(path: Path, rows: dict[str, list]) -> None:
    """One sphere or point a line, so that a change of the fit reads in a diff."""
    links = []
    for name, values in rows.items():
        body = ",\n".join("    " + json.dumps(value) for value in values)
        links.append(f'  "{name}": [\n{body}\n  ]')
    path.write_text("{\n" + ",\n".join(links) + "\n}\n")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", nargs="?", type=Path, help="default: where PANDA.meshes looks")
    parser.add_argument(
        "--links",
        nargs="*",
        choices=list(PLAN),
        default=list(PLAN),
        help="refit only these (none: only seal and measure)",
    )
    args = parser.parse_args()
    if args.folder is None:
        model = PANDA.meshes.find()
        missing = PANDA.meshes.absent
    else:
        named = [args.folder / name for name in ("panda_collision.xml", "panda.xml")]
        model = next((path for path in named if path.is_file()), None)
        missing = f"{args.folder} holds neither panda_collision.xml nor panda.xml"
    if model is None:
        print(missing, file=sys.stderr)
        return 2
    meshes = load_link_meshes(model)

    path = ROBOT / "spheres.json"
    old = json.loads(path.read_text()) if path.exists() else {}
    fitted = {}
    for name, (n, limit) in PLAN.items():
        if name in args.links or name not in old:
            rows = rounded_up(fit_link(meshes[name], n, limit))
        else:
            rows = old[name]
        fitted[name] = rows = sealed(meshes[name], rows)
        figures = measure_cover(meshes[name], np.array(rows), 40_000, seed=1)
        print(
            f"{name}: {len(rows)} spheres, gap {MM * figures.largest_gap:.2f} mm, excess mean "
            f"{MM * figures.mean_excess:.2f} max {MM * figures.max_excess:.2f} mm",
            flush=True,
        )
    fitted["right_finger"] = fitted["left_finger"]
    write_rows(path, fitted)

    moving = {name: mesh for name, mesh in meshes.items() if name != "link0"}
    surface = fit_surface(moving, SURFACE_POINTS)
    rows = {name: points.round(4).tolist() for name, points in surface.items()}
    write_rows(ROBOT / "surface.json", rows)
    return 0


if __name__ == "__main__":
    sys.exit(main())
