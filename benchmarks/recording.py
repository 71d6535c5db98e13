"""What recordings cost: time on top of a run, size of the files, frames a second of videos.
Markdown.

    python benchmarks/recording.py [--batches 4] [--repetitions 3]

Batches of 64 episodes are simulated without and with recording every one of them, by turns, in one
process, after a first turn that compiles everything. With meshes at hand (`DRPBENCH_MESHES`) videos
are timed with both figures of the arm.
"""

import argparse
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from drpbench.compile import use_cache
from drpbench.envs import TASKS, World
from drpbench.evaluation.machine import device_name, versions
from drpbench.plugins.registry import choose
from drpbench.problems import load_set
from drpbench.recording import motion, traced
from drpbench.recording.recorder import Recorder
from drpbench.recording.stage import Stage
from drpbench.recording.video import GRID, Shot
from drpbench.results import Header
from drpbench.robot import PANDA
from drpbench.rollout import LANES, Rollout, Trace

RUNS = [("SE", "rmp"), ("FDO", "rmp"), ("FDO", "straight+dcp-rmp"), ("FDO", "drp")]


@dataclass(frozen=True)
class Cost:
    """Time [s] of an episode, of the clock and of all processors, and a file's size [bytes]."""

    plain: np.ndarray  # (repetitions, 2)
    recorded: np.ndarray  # (repetitions, 2)
    size: float

    def line(self, name: str) -> str:
        more = self.recorded / self.plain - 1.0
        clock, processor = 100 * np.median(more, axis=0)
        low, high = 100 * more[:, 0].min(), 100 * more[:, 0].max()
        plain, recorded = np.median(self.plain, axis=0), np.median(self.recorded, axis=0)
        return (
            f"| {name} | {1e3 * plain[0]:.0f} ms ({1e3 * plain[1]:.0f}) | "
            f"{1e3 * recorded[0]:.0f} ms ({1e3 * recorded[1]:.0f}) | "
            f"{clock:.0f} % ({low:.0f} to {high:.0f}) | {processor:.0f} % | "
            f"{self.size / 1e6:.2f} MB |"
        )


def now() -> np.ndarray:
    return np.array([time.perf_counter(), time.process_time()])


def header_of(policy: str, task: str) -> Header:
    return Header(
        policy=policy,
        policy_parameters=choose(policy).parameters,
        privileged=False,
        tasks=[task],
        problem_set=load_set().name,
        problem_set_sha256=load_set().sha256,
        seed=0,
        precision="float32",
        device=device_name(),
        batch_size=LANES,
        versions=versions(),
        platform="",
        created="2025-01-01T00:00:00Z",
        problems={task: None},
        wall_seconds=0.0,
    )


def cost(task: str, policy: str, batches: int, repetitions: int) -> tuple[Cost, Trace, list[int]]:
    """Of batches of episodes spread over the task."""
    problems = load_set().task(task)
    ids = [i * problems.count // LANES for i in range(LANES)]
    rollout, batch = Rollout(World(TASKS[task]), choose(policy).policy), problems.take(ids)
    header = header_of(policy, task, problems)
    with tempfile.TemporaryDirectory() as folder:
        trace = rollout.run(batch)
        with Recorder(Path(folder)) as recorder:  # compiles
            recorder.watch(header, task, ids, trace)
        size = np.mean([path.stat().st_size for path in Path(folder).glob("*.mcap")])
        plain, recorded = [], []
        for _ in range(repetitions):
            times = [now()]
            for _ in range(batches):
                rollout.run(batch)
            times.append(now())
            with Recorder(Path(folder)) as recorder:
                for _ in range(batches):
                    recorder.watch(header, task, ids, rollout.run(batch))
            times.append(now())
            each = np.diff(times, axis=0) / (batches * LANES)
            plain.append(each[0])
            recorded.append(each[1])
    return Cost(np.array(plain), np.array(recorded), float(size)), trace, ids


def frame_times(
    trace: Trace, ids: list[int], size: tuple[int, int], frames: int, real: bool
) -> np.ndarray:
    """Median time [s] of a frame, of the clock and of the processor; `real`: with the arm's
    meshes."""
    episode = traced(ids[0], load_set().task("FDO"), 0, trace, 0)
    moved, stage = motion(episode), Stage(*size, PANDA, real)
    times = [now()]
    for instant in np.linspace(0, episode.instants - 1, frames + 1).astype(int):
        stage.draw(episode, moved, int(instant))
        times.append(now())
    stage.close()
    return np.median(np.diff(times, axis=0)[1:], axis=0)


def report_frames(trace: Trace, ids: list[int]) -> None:
    tile = tuple(n // 4 for n in GRID.size)
    print("\n| arm | pixels | frames/s | processor time a frame |\n|---|---|---|---|")
    for arm in ("solids", "meshes"):
        if arm == "meshes" and PANDA.meshes.find() is None:
            continue
        for size in (Shot().size, tile):
            clock, processor = frame_times(trace, ids, size, 40, arm == "meshes")
            pixels = f"{size[0]} x {size[1]}"
            print(f"| {arm} | {pixels} | {1 / clock:.0f} | {1e3 * processor:.0f} ms |")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--batches", type=int, default=4, help="of 64 episodes in a run")
    parser.add_argument("--repetitions", type=int, default=3)
    arguments = parser.parse_args()
    use_cache()
    print(f"{device_name()}; per episode: time of the clock (of all processors)\n")
    print("| run | plain | with every episode recorded | more, clock | more, processor | MCAP |")
    print("|---|---|---|---|---|---|")
    for task, policy in RUNS:
        found, trace, ids = cost(task, policy, arguments.batches, arguments.repetitions)
        print(found.line(f"{task}, `{policy}`"), flush=True)
    report_frames(trace, ids)


if __name__ == "__main__":
    main()
