"""Inference of IMPACT, and on a CPU with torch, side by side, that of the paper's network in
PyTorch.

    python benchmarks/impact_inference.py [--sizes small full] [--batches 1 64]

Same weights, same clouds, same outputs: they are compared before anything is timed, and must agree
to 1e-4. The last row of each pair gives PyTorch the neighbourhoods for nothing, while ours still
finds them. The two take turns within one run. Wall time is what a user waits; core time is what all
threads burn, which other work on the machine disturbs less. On a machine that is not idle, pin the
run to one core (`taskset -c 0`): waiting threads burn time too. *Cold* is the first call of all,
compiling included.
"""

import argparse
import platform
import time

import jax
import jax.numpy as jnp
import numpy as np

from drpbench.contract import ROBOT_POINTS, SCENE_POINTS
from drpbench.evaluation.machine import device_name
from drpbench.policies.networks.impact import SIZES, apply, initial
from drpbench.robot import PANDA


def observed(batch: int):
    """Random clouds on a few faces, about as dense as the benchmark's, and random joints."""
    rng = np.random.default_rng(0)
    scene = rng.uniform(-0.6, 0.6, (batch, SCENE_POINTS, 3))
    face = rng.integers(3, size=scene.shape[:2])
    scene[np.arange(batch)[:, None], np.arange(SCENE_POINTS), face] = rng.choice(
        [-0.5, 0.0, 0.4], face.shape
    )
    robot = rng.uniform(-0.3, 0.3, (batch, ROBOT_POINTS, 3))
    joints = rng.uniform(PANDA.joint_lower, PANDA.joint_upper, (2, batch, 7))
    mask = np.ones(scene.shape[:2], bool)
    return tuple(
        x if x.dtype == bool else x.astype(np.float32) for x in (scene, mask, robot, *joints)
    )


def seconds(function, *inputs) -> tuple[float, float]:
    """Wall time and core time [s] of one call."""
    wall, core = time.perf_counter(), time.process_time()
    jax.block_until_ready(function(*inputs))
    return time.perf_counter() - wall, time.process_time() - core


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--sizes", nargs="+", choices=SIZES, default=list(SIZES))
    parser.add_argument("--batches", nargs="+", type=int, default=[1, 64])
    parser.add_argument("--repetitions", type=int, default=15)
    arguments = parser.parse_args()
    try:
        import torch
        from impact_in_torch import TorchImpact, neighbourhoods
    except ImportError:
        torch = None
    against = (
        f"torch {torch.__version__} on {torch.get_num_threads()} threads" if torch else "no torch"
    )
    print(
        f"{device_name()}; {platform.machine()}, jax {jax.__version__}, {against}; "
        f"ms a sample, median of {arguments.repetitions} turns\n"
    )
    print(
        "| size | batch | cold [s] | PyTorch's neighbourhoods | here: wall | core | PyTorch: wall "
        "| core "
        "| PyTorch / here: wall | core |\n|---|---|---|---|---|---|---|---|---|---|"
    )
    for name in arguments.sizes:
        size = SIZES[name]
        parameters = initial(size)
        # An output layer as large as a trained one's, so that equal outputs mean something.
        parameters["out"]["kernel"] = 10.0 * parameters["out"]["kernel"]
        compiled = jax.jit(lambda p, *seen, size=size: apply(size, p, *seen))
        # What the small network has beyond the paper's stands in JAX only.
        other = TorchImpact(size, parameters) if torch and not size.sees_goal else None
        for batch in arguments.batches:
            seen = observed(batch)
            ours = tuple(map(jnp.asarray, seen))
            cold, _ = seconds(compiled, parameters, *ours)
            if other is None:
                turns = [seconds(compiled, parameters, *ours) for _ in range(arguments.repetitions)]
                w, c = 1e3 * np.median(turns, axis=0) / batch
                print(
                    f"| {name} | {batch} | {cold:.1f} | – | {w:.4f} | {c:.4f} | – | – | – | – |",
                    flush=True,
                )
                continue
            other.given = {}
            theirs = tuple(map(torch.from_numpy, seen))
            expected = other(*theirs).numpy()
            found = np.asarray(compiled(parameters, *ours))
            apart = np.abs(found - expected).max()
            if apart > 1e-4:
                raise SystemExit(f"{name}, batch {batch}: outputs differ by {apart:.1e}")
            for given in (False, True):
                other.given = neighbourhoods(other, theirs) if given else {}
                turns = [
                    (*seconds(compiled, parameters, *ours), *seconds(other, *theirs))
                    for _ in range(arguments.repetitions)
                ]
                w, c, tw, tc = 1e3 * np.median(turns, axis=0) / batch
                wall, core = np.median([(t[2] / t[0], t[3] / t[1]) for t in turns], axis=0)
                print(
                    f"| {name} | {batch} | {cold:.1f} | {'given' if given else 'found'} | {w:.2f} "
                    f"| {c:.2f} "
                    f"| {tw:.2f} | {tc:.2f} | {wall:.2f} | {core:.2f} |",
                    flush=True,
                )


if __name__ == "__main__":
    main()
