"""Is this installation sound? Versions, the device, and self-tests of verdict and network.

The self-test puts a box, a cylinder and a sphere onto every link but the immovable base, in several
configurations, and asks the compiled world's own contact function; a link that goes unseen, or a
clearance that differs from the one computed in plain numpy, fails it. Benchmarks have reported arms
that pass through obstacles for months because nothing looked.

A second one asks IMPACT's set abstraction for neighbourhoods and looks whether they are the right
ones.
"""

from dataclasses import dataclass, field

import jax
import jax.numpy as jnp
import numpy as np

from drpbench.compile import jit
from drpbench.envs import contact
from drpbench.geometry import SHAPES, Primitives
from drpbench.policies.networks.set_abstraction import check_neighbourhoods
from drpbench.problems import ProblemSetError, load_set
from drpbench.robot import PANDA, Robot

from .machine import device_name, processor, versions

_SIZE = 0.03  # [m] half size of the probes
_DRAWN = 7  # configurations, beside the home posture
_FAR = np.array([5.0, 5.0, 5.0])  # [m] where a probe touches nothing


@dataclass
class Report:
    """Facts by name, and checks as (name, passed, detail)."""

    facts: dict[str, str] = field(default_factory=dict)
    checks: list[tuple[str, bool, str]] = field(default_factory=list)

    @property
    def healthy(self) -> bool:
        return all(passed for _, passed, _ in self.checks)


def examine(robot: Robot = PANDA) -> Report:
    """Everything `drpbench doctor` prints."""
    report = Report(facts={**versions(), "device": f"{device_name()} ({jax.default_backend()})"})
    report.facts["processor"] = processor()
    try:
        sizes = load_set().counts
        detail = ", ".join(f"{task} {count}" for task, count in sizes.items())
        report.checks.append(("problems", True, f"checksum right; {detail}"))
    except ProblemSetError as error:
        report.checks.append(("problems", False, str(error)))
    report.checks += _see_every_link(robot)
    fault = check_neighbourhoods()
    detail = "as counted by hand" if fault is None else fault
    report.checks.append(("point neighbourhoods", fault is None, detail))
    return report


def _probe(kind: jax.Array, position: jax.Array) -> Primitives:
    return Primitives(
        kind=jnp.full(1, kind, jnp.int32),
        half_size=jnp.full((1, 3), _SIZE),
        position=jnp.asarray(position, jnp.float32)[None],
        rotation=jnp.eye(3)[None],
        mask=jnp.ones(1, bool),
    )


def _see_every_link(robot: Robot) -> list[tuple[str, bool, str]]:
    model = robot.moving_spheres
    rng = np.random.default_rng(0)
    configurations = np.concatenate(
        [
            robot.home[None],
            rng.uniform(robot.joint_lower, robot.joint_upper, (_DRAWN, robot.joints)),
        ]
    )

    def meet(q, kind, position):
        poses = robot.link_poses(q)
        touch = contact(poses, jnp.zeros(robot.joints), model.world(poses), _probe(kind, position))
        return touch.clearance, touch.sphere

    compiled = jit(jax.vmap(meet))
    centers = np.asarray(
        jax.vmap(lambda q: model.world(robot.link_poses(q)))(jnp.asarray(configurations))
    )
    cases = [
        (c, kind, link, centers[c, model.link == link].mean(axis=0))
        for c in range(len(configurations))
        for kind in range(len(SHAPES))
        for link in range(1, len(robot.link_names))
    ]
    q = jnp.asarray(np.stack([configurations[c] for c, *_ in cases]), jnp.float32)
    kinds = jnp.asarray([kind for _, kind, *_ in cases], jnp.int32)
    places = jnp.asarray(np.stack([place for *_, place in cases]), jnp.float32)
    clearance, _ = map(np.asarray, compiled(q, kinds, places))
    away, _ = map(np.asarray, compiled(q, kinds, jnp.broadcast_to(_FAR, places.shape)))

    expected = np.array(
        [_by_hand(kind, centers[c] - place, model.radius) for c, kind, _, place in cases]
    )
    checks = []
    for link in range(1, len(robot.link_names)):
        mine = [i for i, (_, _, of, _) in enumerate(cases) if of == link]
        unseen = [SHAPES[cases[i][1]] for i in mine if clearance[i] >= 0.0]
        off = float(np.abs(clearance[mine] - expected[mine]).max())
        passed = not unseen and off < 1e-4 and bool((away[mine] > 1.0).all())
        detail = f"{len(mine)} collisions seen, clearance right to {1000 * off:.4f} mm"
        if unseen:
            detail = (
                f"unseen in {len(unseen)} of {len(mine)} cases: {', '.join(sorted(set(unseen)))}"
            )
        checks.append((robot.link_names[link], passed, detail))
    return checks


def _by_hand(kind: int, offset: np.ndarray, radius: np.ndarray) -> float:
    """Smallest distance of spheres about `offset` (S, 3) to a probe at the origin, shape by
    shape."""
    if SHAPES[kind] == "sphere":
        distance = np.linalg.norm(offset, axis=1) - _SIZE
    else:
        if SHAPES[kind] == "cylinder":
            offset = np.stack([np.hypot(offset[:, 0], offset[:, 1]), offset[:, 2]], axis=1)
        beyond = np.abs(offset) - _SIZE
        distance = np.linalg.norm(np.maximum(beyond, 0), axis=1) + np.minimum(beyond.max(axis=1), 0)
    return float((distance - radius).min())
