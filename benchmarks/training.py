"""Training samples per second of IMPACT, and where their time goes.

    python benchmarks/training.py --size small --batch 256
    python benchmarks/training.py --size full --batch 512 --precision bfloat16 --trace trace/

Four programs, each of which holds the one before it: drawing the samples (scenes, clouds, targets),
the network's answer, the gradient, the whole step with its update. Their differences say where the
time goes. The data are sampled hints, so that the expert is not part of it. `--trace` writes a
profile of the whole step that TensorBoard or Perfetto open.
"""

from __future__ import annotations

import argparse
import statistics
import time
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

from drpbench.compile import use_cache
from drpbench.generation.training_problems import Drawer
from drpbench.geometry import stacked
from drpbench.learning.cloning import Cloning, CloningSettings
from drpbench.learning.demonstrations import Demonstrations
from drpbench.learning.learners import learner
from drpbench.policies.networks.impact import SIZES, apply
from drpbench.robot import PANDA


def demonstrations(count: int) -> Demonstrations:
    """The hints of the first problems, as if the expert had kept them."""
    drawer = Drawer("benchmarks")
    drawn = [drawer.draw(number) for number in range(count)]
    stack = {
        name: np.stack([getattr(one, name) for one in drawn])
        for name in ("index", "family", "goal")
    }
    stack["obstacles"] = stacked([one.obstacles for one in drawn])
    path = np.stack([one.hint for one in drawn])
    steps = np.abs(np.diff(path, axis=1)) / PANDA.velocity_limit
    length = steps.max(axis=2).sum(axis=1).astype(np.float32)
    return Demonstrations(**stack, path=path, length=length, reached=np.ones(count, bool))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--size", choices=SIZES, default="small")
    parser.add_argument("--batch", type=int, default=256)
    parser.add_argument("--precision", choices=("float32", "bfloat16"), default="float32")
    parser.add_argument("--steps", type=int, default=10, help="steps a call")
    parser.add_argument("--calls", type=int, default=5, help="calls timed")
    parser.add_argument("--trace", type=Path, help="folder for a profile of one call")
    asked = parser.parse_args()

    use_cache()
    size = SIZES[asked.size]
    network = learner("impact", asked.size)
    settings = CloningSettings(steps=10**6, batch=asked.batch, precision=asked.precision)
    trainer = Cloning(network, settings)
    data = trainer.resident(demonstrations(256))
    state = trainer.begin()

    def batches(compute):
        """A program of so many steps that need `compute` of every batch."""

        @jax.jit
        def run(parameters, first):
            def step(total, number):
                key = jax.random.fold_in(jax.random.key(0), first + number)
                return total + compute(parameters, network.sample(key, data, asked.batch)), None

            return jax.lax.scan(step, jnp.float32(0), jnp.arange(asked.steps))[0]

        return lambda call: run(state.parameters, call * asked.steps)

    def total(tree):
        return sum(jnp.sum(leaf.astype(jnp.float32)) for leaf in jax.tree.leaves(tree))

    def answer(parameters, b):
        seen = (b.scene_points, b.scene_mask, b.robot_points, b.joints, b.goal)
        return total(apply(size, parameters, *seen, dtype=asked.precision))

    def whole(call):
        nonlocal state
        state, losses = trainer.advance(state, data, steps=asked.steps)
        return losses

    programs = {
        "drawing samples": batches(lambda parameters, b: total(b)),
        "+ the network's answer": batches(answer),
        "+ its gradient": batches(
            lambda parameters, b: total(jax.grad(trainer.loss)(parameters, b))
        ),
        "+ the update: all": whole,
    }
    print(f"{jax.devices()[0].device_kind}, {asked.size}, batch {asked.batch}, {asked.precision}")
    for name, program in programs.items():
        jax.block_until_ready(program(0))
        times = []
        for call in range(1, asked.calls + 1):
            began = time.perf_counter()
            jax.block_until_ready(program(call))
            times.append((time.perf_counter() - began) / (asked.steps * asked.batch))
        print(
            f"{name:<24} {statistics.median(times) * 1e6:9.1f} us a sample, "
            f"{1 / statistics.median(times):9.0f} samples/s"
        )
    if asked.trace:
        with jax.profiler.trace(str(asked.trace)):
            jax.block_until_ready(whole(0))
        print(f"profile in {asked.trace}")


if __name__ == "__main__":
    main()
