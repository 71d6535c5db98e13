"""What the time between the command and the first control step goes into.

    python benchmarks/compile_time.py --task FDO --policy rmp --parts

For each function that a rollout compiles: seconds of tracing (Python to jaxpr), lowering (jaxpr to
StableHLO) and compiling (XLA's passes and LLVM), processor time of all threads, which other work on
the machine moves little; and how many StableHLO and, after XLA's passes, HLO instructions there
are. `--parts` does the same with the parts of a control step, each compiled alone for the same 64
lanes.
"""

import argparse
import re
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp

from drpbench.compile import jit
from drpbench.envs import TASKS, World
from drpbench.envs.contact import contact
from drpbench.envs.dynamics import substep
from drpbench.plugins.registry import choose
from drpbench.problems import load_set
from drpbench.rollout import LANES
from drpbench.rollout.batch import CHUNK, advance, begin


@dataclass(frozen=True)
class Cost:
    """Processor seconds; StableHLO instructions, and HLO ones after XLA's passes."""

    tracing: float
    lowering: float
    compiling: float
    lowered: int
    optimised: int

    @property
    def total(self) -> float:
        return self.tracing + self.lowering + self.compiling


def measured(function: Callable, *arguments: Any) -> tuple[Cost, Any]:
    """What compiling `function` for the arguments costs, and the compiled function."""
    began = time.process_time()
    traced = function.trace(*arguments)
    after_tracing = time.process_time()
    lowered = traced.lower()
    after_lowering = time.process_time()
    compiled = lowered.compile()
    ended = time.process_time()
    cost = Cost(
        tracing=after_tracing - began,
        lowering=after_lowering - after_tracing,
        compiling=ended - after_lowering,
        lowered=len(re.findall(r"(?m)^\s+%\S+ = ", lowered.as_text())),
        optimised=len(re.findall(r"(?m)^\s+(?:ROOT )?%?\S+ = ", compiled.as_text())),
    )
    return cost, compiled


def rollout_costs(world: World, policy: Any, problems: Any) -> Iterator[tuple[str, Cost]]:
    """The reset of a batch, and a chunk of 100 control steps."""
    cost, reset = measured(begin, world, policy, 0, problems)
    yield "reset", cost
    state, carry, _ = reset(policy, problems)
    clocks = jnp.arange(CHUNK, dtype=jnp.int32)
    yield f"{CHUNK} steps", measured(advance, world, policy, 0, state, carry, clocks)[0]


def part_costs(world: World, policy: Any, problems: Any) -> Iterator[tuple[str, Cost]]:
    """The parts of a control step, each alone."""
    state, carry, _ = begin(world, policy, 0, problems)
    privileged, robot = policy.privileged, world.robot

    def answer(state, carry):
        observation = world.observe(state, privileged)
        return policy.act(observation, carry, jax.random.key(0))

    def move(state):
        q, qd = state.joint_position, state.joint_velocity
        return substep(q, qd, state.reference, state.contact_torque)

    def touch(state):
        poses = robot.link_poses(state.joint_position)
        centers = robot.moving_spheres.world(poses)
        return contact(poses, state.joint_velocity, centers, world.obstacles(state), robot)

    parts = {
        "observation": lambda state: world.observe(state, privileged),
        "link poses": lambda state: robot.link_poses(state.joint_position),
        "MJX substep": move,
        "contact": touch,
        "self-clearance": lambda state: robot.self_clearance(
            robot.link_poses(state.joint_position)
        ),
        "world's step": lambda state: world.step(state, state.reference, jnp.int32(0)),
    }
    yield "observation and policy", measured(jit(jax.vmap(answer)), state, carry)[0]
    for name, part in parts.items():
        yield name, measured(jit(jax.vmap(part)), state)[0]


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--task", default="FDO", choices=TASKS)
    parser.add_argument("--policy", default="rmp")
    parser.add_argument("--parts", action="store_true")
    asked = parser.parse_args()
    world, policy = World(TASKS[asked.task]), choose(asked.policy).policy
    problems = load_set().task(asked.task).take(range(LANES))
    problems = jax.tree.map(jnp.asarray, problems)
    jax.block_until_ready(jnp.zeros(1) + 1)  # the backend's own start is no compilation

    print(f"{asked.policy} on {asked.task}, {LANES} lanes, {jax.devices()[0].platform}")
    print(f"{'':24}{'trace':>8}{'lower':>8}{'compile':>9}{'all':>8}     StableHLO        HLO")

    def show(name: str, cost: Cost) -> None:
        seconds = f"{cost.tracing:8.2f}{cost.lowering:8.2f}{cost.compiling:9.2f}{cost.total:8.2f}"
        print(f"{name:24}{seconds}   {cost.lowered:11}{cost.optimised:11}", flush=True)

    for name, cost in rollout_costs(world, policy, problems):
        show(name, cost)
    for name, cost in part_costs(world, policy, problems) if asked.parts else ():
        show(name, cost)


if __name__ == "__main__":
    main()
