"""What a policy outside jit costs: control steps per second, beside the same policy in JAX.

    python benchmarks/host_policy.py
    python benchmarks/host_policy.py --batch 256 --repeats 5

The policies are those of examples/: a few additions, so that what is timed is the way there and
back. Each repeat runs every way of asking once, in turn, on whole episodes of the same problems;
ratios are taken within a repeat, and their median and range shown. `remote` is
examples/remote_policy.py in a process of its own, over TCP on this machine.
"""

from __future__ import annotations

import argparse
import importlib.util
import socket
import statistics
import subprocess
import sys
import time
from pathlib import Path

import jax

from drpbench.compile import use_cache
from drpbench.envs import TASKS, World
from drpbench.plugins.errors import PolicyError
from drpbench.plugins.registry import choose
from drpbench.problems import load_set
from drpbench.rollout import LANES, Rollout

EXAMPLES = Path(__file__).parents[1] / "examples"


def remote() -> tuple[subprocess.Popen, str]:
    """The example of a remote policy, started, and the name to run it by."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        address = f"127.0.0.1:{probe.getsockname()[1]}"
    command = [sys.executable, str(EXAMPLES / "remote_policy.py"), address]
    server = subprocess.Popen(command, stdout=subprocess.PIPE)
    server.stdout.readline()  # it listens
    return server, f"remote:{address}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--task", choices=TASKS, default="FDO")
    parser.add_argument("--batch", type=int, default=LANES)
    parser.add_argument("--repeats", type=int, default=3)
    options = parser.parse_args()
    use_cache()
    sys.path.insert(0, str(EXAMPLES))
    server, address = remote()
    names = {"jax": "jax_policy:Approach", "numpy": "numpy_policy:Approach"}
    if importlib.util.find_spec("torch"):
        names["torch"] = "torch_policy:Approach"
    names["remote"] = address
    problems = load_set().task(options.task)
    world = World(TASKS[options.task])
    batch = problems.take([i % len(problems.level) for i in range(options.batch)])
    try:
        rollouts = {
            name: Rollout(world, choose(path).policy, lanes=options.batch)
            for name, path in names.items()
        }
        seconds: dict[str, list[float]] = {name: [] for name in names}
        for rollout in rollouts.values():
            rollout.run(batch)  # compiles
        for _ in range(options.repeats):
            for name, rollout in rollouts.items():
                began = time.perf_counter()
                if failure := rollout.run(batch).failure:
                    raise PolicyError(f"{name}: {failure}")
                seconds[name].append(time.perf_counter() - began)
    finally:
        server.kill()
        server.wait()

    print(
        f"{options.task}, batch {options.batch}, {jax.devices()[0].device_kind}, jax "
        f"{jax.__version__}"
    )
    print("policy    control steps/s   ms a step of the batch   times the time of jax [range]")
    for name, taken in seconds.items():
        ratios = [a / b for a, b in zip(taken, seconds["jax"], strict=True)]
        typical = statistics.median(taken)
        print(
            f"{name:<9} {options.batch * world.episode.steps / typical:15,.0f}"
            f"   {1000 * typical / world.episode.steps:22.2f}"
            f"   {statistics.median(ratios):.2f} [{min(ratios):.2f}, {max(ratios):.2f}]"
        )


if __name__ == "__main__":
    main()
