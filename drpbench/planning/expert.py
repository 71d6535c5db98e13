"""The expert: a batched trajectory optimiser that shows how to reach a joint-space goal.

For each problem several seeds (the straight line, paths through via points, hints from a sampling
planner) are optimised at once, every verdict comes from a check at fine resolution, and the
shortest path that passes is returned. In the manner of cuRobo (Sundaralingam et al., 2023) and of
CHOMP (Zucker et al., 2013), but second order: the unknowns are the control points c of a clamped
cubic B-spline q(s), s in [0, 1], and Levenberg and Marquardt's method minimises

    sum_i 1/2 c_i^T R c_i  +  WEIGHT / T sum_t sum_k 1/2 max(0, a_tk - d_tk)^2

over all but the first and last of them. R holds the integrals of squared velocity, acceleration and
jerk; d_tk is the clearance of sphere k of the arm at waypoint t, a_tk the clearance that is wanted.
The damping is a multiple of R, so steps are smooth. Where nothing is near, the straight line at
even speed is the minimum. Where the goal is obstructed, each seed is first cut off and led to the
nearest place to stop (`stopping.py`).
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, PRNGKeyArray

from drpbench.compile import jit
from drpbench.geometry import Field
from drpbench.robot import PANDA, Robot

from .clearance_cost import Gaps, clearance_cost, gaps
from .joint_limits import inner_limits
from .levenberg_marquardt import minimise
from .path_check import check_path
from .retiming import uniform
from .spline import basis, energy, fit
from .stopping import shortened, touches

ACTIVATION = 0.06  # [m] from obstacles that paths keep where they can
OWN_ACTIVATION = 0.01  # [m] between the links of `Gaps.own`
_LEAST_ACTIVATION = 0.007  # [m] at a start or goal that has less
_RAMP = 10  # waypoints from either end over which the activation rises to its full value
_SMOOTHNESS = (1.0, 2.5e-3, 1.0e-6)  # of the integrals of squared velocity, acceleration, jerk
_WEIGHT = 2.0e4  # [rad^2/m^2] of obstacles
_VIA_SPREAD = 0.8  # [rad]


@dataclass(frozen=True)
class PlannerSettings:
    """Sizes of the search; fixed for a compiled planner.

    `waypoints` a path (a power of two: what is learned from is stored in such arrays; at 64 the arm
    rarely moves more than 5 cm between two, less than any obstacle with the clearance wanted about
    it is thick), `control_points` of its spline, `iterations` of the optimiser; `vias` is the
    number of seeds through via points, beside the straight line and the hints. With `stop_short`,
    what was not solved is searched again for a path that stops before the goal.
    """

    waypoints: int = 64
    control_points: int = 20
    iterations: int = 15
    vias: int = 0
    stop_short: bool = False


CHEAP = PlannerSettings()
"""For CPUs, with a hint: the straight line and the hint are the only seeds."""
THOROUGH = PlannerSettings(iterations=30, vias=15, stop_short=True)
"""For GPUs, or without a hint."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Plan:
    """A path of T waypoints [rad], at even steps of length (`retiming.uniform`); batched as
    planned.

    `success`: the path passed the check and may be used. It ends at the goal where `reached`, and
    else as near to it as the arm gets without touching. `obstructed`: the goal itself is in
    collision, so it cannot be reached. `clearance` [m] is the smallest along the path, `length` [s]
    the least time that the velocity limits allow for it.
    """

    path: Float[Array, "*batch T J"] | Float[np.ndarray, "*batch T J"]
    success: Bool[Array, "*batch"] | Bool[np.ndarray, "*batch"]
    reached: Bool[Array, "*batch"] | Bool[np.ndarray, "*batch"]
    obstructed: Bool[Array, "*batch"] | Bool[np.ndarray, "*batch"]
    clearance: Float[Array, "*batch"] | Float[np.ndarray, "*batch"]
    length: Float[Array, "*batch"] | Float[np.ndarray, "*batch"]


def _seeds(start, goal, key, hints, lower, upper, settings, robot):
    """(S, T, J): the straight line, the hints, and lines through via points.

    The first via point is the home posture, turned half way; of the others one half lies about the
    middle of the line, the other anywhere within the limits.
    """
    middle = 0.5 * (start + goal)
    home = jnp.asarray(robot.home, start.dtype).at[0].set(middle[0])
    near_key, far_key = jax.random.split(key)
    count = settings.vias // 2
    near = middle + _VIA_SPREAD * jax.random.normal(near_key, (count, robot.joints))
    far = jax.random.uniform(far_key, (count, robot.joints), minval=lower, maxval=upper)
    vias = jnp.clip(jnp.concatenate([home[None], near, far])[: settings.vias], lower, upper)
    corners = jax.vmap(lambda via: jnp.stack([start, via, goal]))(vias)
    line = jnp.stack([start, goal])[None]
    groups = [line, corners] if hints is None else [line, hints, corners]
    seeds = [
        jax.vmap(lambda path: uniform(path, settings.waypoints, robot)[0])(group)
        for group in groups
        if len(group)
    ]
    return jnp.concatenate(seeds).at[:, 0].set(start).at[:, -1].set(goal)


def _activations(ends: Gaps, count: int) -> Gaps:
    """(T, spheres) [m]: as much as is wanted, but no more than there is at the ends, rising from
    there."""

    def between(clearance, least, most):
        rise = most * jnp.arange(count)[:, None] / _RAMP
        first, last = jnp.maximum(clearance, least)
        return jnp.minimum(most, jnp.minimum(first + rise, last + rise[::-1]))

    return Gaps(
        between(ends.obstacle, _LEAST_ACTIVATION, ACTIVATION),
        between(ends.own, 0.1 * OWN_ACTIVATION, OWN_ACTIVATION),
    )


def _optimise(seed, obstacles, activations, lower, upper, settings, robot):
    """Control points (n, J) from those of a seed, by Levenberg and Marquardt's method."""
    n, count, joints = settings.control_points, settings.waypoints, robot.joints
    values = basis(n, count)
    smooth = energy(n, *_SMOOTHNESS)
    weight = _WEIGHT / count
    size = joints * (n - 2)
    multiply = partial(jnp.einsum, precision="highest")

    def evaluate(control):
        path = multiply("ti,ia->ta", values, control)
        cost, gradient, hessian = jax.vmap(lambda q, a: clearance_cost(q, obstacles, a, robot))(
            path, activations
        )
        total = 0.5 * multiply("ia,ij,ja->", control, smooth, control) + weight * jnp.sum(cost)
        return total, weight * gradient, weight * hessian

    def propose(control, gradient, hessian, damping):
        slope = multiply("ti,ta->ia", values, gradient) + multiply("ij,ja->ia", smooth, control)
        whole = multiply("ti,tj,tab->iajb", values, values, hessian)
        whole = whole + ((1.0 + damping) * smooth)[:, None, :, None] * jnp.eye(joints)[:, None, :]
        factor = jax.scipy.linalg.cho_factor(whole[1:-1, :, 1:-1].reshape(size, size))
        move = -jax.scipy.linalg.cho_solve(factor, slope[1:-1].reshape(size))
        inner = jnp.clip(control[1:-1] + move.reshape(n - 2, joints), lower, upper)
        return control.at[1:-1].set(inner)

    return minimise(evaluate, propose, seed, settings.iterations)


def _search(seeds, short, goal, obstacles, lower, upper, settings, robot):
    """The best path that comes of the seeds, its clearance and length, and whether it is any good.

    Where `short`, the seeds are cut off at a place to stop first, and the best ends nearest to the
    goal.
    """
    n, count = settings.control_points, settings.waypoints
    cut = jax.vmap(lambda path: shortened(path, goal, obstacles, lower, upper, robot))(seeds)
    seeds = jnp.where(short, cut, seeds)

    def improve(seed):
        control = jnp.einsum("it,ta->ia", fit(n, count), seed, precision="highest")
        control = control.at[0].set(seed[0]).at[-1].set(seed[-1])
        ends = jax.vmap(lambda q: gaps(q, obstacles, robot))(seed[jnp.array([0, -1])])
        activations = _activations(ends, count)
        control = _optimise(control, obstacles, activations, lower, upper, settings, robot)
        curve = jnp.einsum("ti,ia->ta", basis(n, 4 * count), control, precision="highest")
        curve = curve.at[0].set(control[0]).at[-1].set(control[-1])
        path, length = uniform(curve, count, robot)
        return path, length, check_path(path, obstacles, robot)

    paths, lengths, verdicts = jax.vmap(improve)(seeds)
    left = jnp.sum((paths[:, -1] - goal) ** 2, axis=1)
    rank = jnp.where(short, left, lengths) + jnp.where(verdicts.free, 0.0, 1.0e6)
    best = jnp.argmin(rank)
    return paths[best], verdicts.free[best], verdicts.clearance[best], lengths[best]


def plan(
    obstacles: Field,
    start: Float[Array, " J"],
    goal: Float[Array, " J"],
    key: PRNGKeyArray,
    hints: Float[Array, "H m J"] | None = None,
    settings: PlannerSettings = CHEAP,
    robot: Robot = PANDA,
) -> Plan:
    """The shortest path found from `start` to `goal` [rad] among `obstacles`, as `Plan`.

    Paths keep `LIMIT_MARGIN` from the joint limits, but for a start or goal beyond.

    `hints` are polylines from a sampling planner, of any number of waypoints; one that is shorter
    than the others repeats its last waypoint. Without success the path is the best of the seeds'
    and must not be used.
    """
    ends = jnp.stack([start, goal])
    least, most = inner_limits(robot, np.float32)
    lower, upper = jnp.minimum(least, ends.min(axis=0)), jnp.maximum(most, ends.max(axis=0))
    seeds = _seeds(start, goal, key, hints, lower, upper, settings, robot)
    obstructed = touches(gaps(goal, obstacles, robot))
    modes = jnp.stack([obstructed, jnp.array(True)])[: 1 + settings.stop_short]
    # A loop over both modes, and not two searches, for the compiler's sake.
    found = jax.lax.map(
        lambda short: _search(seeds, short, goal, obstacles, lower, upper, settings, robot), modes
    )
    chosen = jnp.where(found[1][0], 0, len(modes) - 1)
    path, success, clearance, length = jax.tree.map(lambda leaf: leaf[chosen], found)
    reached = found[1][0] & ~obstructed
    return Plan(path, success, reached, obstructed, clearance, length)


def planner(settings: PlannerSettings = CHEAP, robot: Robot = PANDA) -> Callable[..., Plan]:
    """`plan` compiled for batches: each argument with one leading axis B (`hints` may be None)."""
    return _planner(settings, robot)


@cache
def _planner(settings: PlannerSettings, robot: Robot) -> Callable[..., Plan]:
    return jit(jax.vmap(partial(plan, settings=settings, robot=robot)))
