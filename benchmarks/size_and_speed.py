"""Parameters, cold start and latency of every policy at a batch of one, as Markdown.

    python benchmarks/size_and_speed.py [--policies drp rmp] [--steps 60]

Each policy is shown the start of one problem of FDO, which stands still, and answers `--steps`
control steps. Cold: compiling the policy, and its first answer. Start: what an episode begins with,
a plan for those that plan. Step: a control step's answer, in the mean and at most. A policy that
cannot be made here is named below the table.
"""

import argparse
import time
from functools import partial

import jax
import numpy as np

from drpbench.compile import jit
from drpbench.envs import TASKS, World
from drpbench.errors import DrpbenchError
from drpbench.plugins.host import Hosted
from drpbench.plugins.registry import POLICIES, choose
from drpbench.problems import load_set
from drpbench.rollout.step import reset


def timed(call, *arguments):
    """The answer, and the seconds that it took."""
    began = time.perf_counter()
    answer = jax.block_until_ready(call(*arguments))
    return answer, time.perf_counter() - began


def answers(policy, observe):
    """`start()` and `step()`, which answer what an episode begins with and then each step."""
    observation = jax.block_until_ready(observe(policy.privileged))
    if isinstance(policy, Hosted):
        batch = jax.tree.map(lambda leaf: leaf[None], observation)
        shown = jit(policy.shown.act)
        shown(observation, (), None)
        return partial(policy.reset, batch, 1), partial(policy.act, batch, 1)
    init, act = jit(policy.init), jit(policy.act)
    carry = None

    def start():
        nonlocal carry
        carry = init(observation)
        return carry

    def step():
        nonlocal carry
        target, carry = act(observation, carry, jax.random.key(0))
        return target

    return start, step


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--policies", nargs="+", default=[*POLICIES, "neuralmp+tto"])
    parser.add_argument("--steps", type=int, default=60)
    arguments = parser.parse_args()
    world = World(TASKS["FDO"])
    problem = load_set().task("FDO").take([0])
    problem = jax.tree.map(lambda leaf: leaf[0], problem)
    state = jit(partial(reset, world, 0))(problem)
    observe = jit(partial(world.observe, state), static_argnums=0)
    print(
        "| policy | parameters | cold [s] | start [ms] | step [ms] | slowest step [ms] |\n"
        "|---|---|---|---|---|---|"
    )
    absent = []
    for name in arguments.policies:
        try:
            policy = choose(name).policy
        except DrpbenchError as error:
            absent.append(f"{name}: {error}")
            continue
        leaves = [] if isinstance(policy, Hosted) else jax.tree.leaves(policy)
        count = sum(leaf.size for leaf in leaves if np.ndim(leaf))
        start, step = answers(policy, observe)
        cold = timed(start)[1] + timed(step)[1]
        again = timed(start)[1]
        steps = [timed(step)[1] for _ in range(arguments.steps)]
        print(
            f"| `{name}` | {f'{count:,}' if count else '–'} | {cold:.1f} | {1e3 * again:.2f} | "
            f"{1e3 * np.mean(steps):.2f} | {1e3 * np.max(steps):.1f} |",
            flush=True,
        )
    print("\n".join(["", *absent]) if absent else "", end="")


if __name__ == "__main__":
    main()
