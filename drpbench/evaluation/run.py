"""A whole run: every problem asked for exactly once, in batches, safe on disk after each."""

import datetime
import platform
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from drpbench.compile import pinned
from drpbench.contract import PROTOCOL, Policy
from drpbench.envs import TASKS, World
from drpbench.perception import SurfaceCloud
from drpbench.plugins.errors import PolicyError
from drpbench.plugins.host import TIME_LIMIT, Hosted
from drpbench.plugins.isolation import isolated
from drpbench.plugins.registry import Choice, choose, split
from drpbench.problems import ProblemSet, ProblemSetError, load_set
from drpbench.results import Header, Journal, Result
from drpbench.results.trajectories import Trajectories
from drpbench.rollout import LANES, Rollout, Trace

from .machine import device_name, environment, processor, versions
from .metrics import rows as rows_of
from .progress import RunProgress

KEPT = ". The rows so far are kept; go on with --resume"
"""What is said when a run breaks off because its policy is gone."""

Watch = Callable[[Header, str, Sequence[int], Trace], None]
"""What is shown each batch of a run before its rows are safe: header, task, ids, trace."""


@dataclass(frozen=True)
class Request:
    """What to run. `problems` maps each task, in order, to ids of `problem_set`, or None for all of
    them; `policy_arguments` are the policy's own parameters, each as "name=value"."""

    policy: str
    problems: Mapping[str, Sequence[int] | None]
    out: Path
    problem_set: ProblemSet = field(default_factory=load_set)
    policy_arguments: Sequence[str] = ()
    choice: Choice | None = None
    """The policy itself, where it is at hand: `policy` is then only what it is called."""
    name: str = ""
    """What the leaderboard calls the run; empty: as its policy."""
    isolated: bool = False
    """Whether the policy is kept in a process of its own (`plugins.isolation`)."""
    shard: str = ""
    """Which part of a run the problems are, as `3/16`; empty: they are the run."""
    time_limit: float = TIME_LIMIT  # [s] a control step, for policies outside jit
    seed: int = 0
    batch_size: int = LANES
    resume: bool = False
    save_trajectories: bool = False
    watch: Watch | None = None


def world_of(problem_set: ProblemSet, task: str) -> World:
    """The world of one task of a set: its arm, and a sensor that knows whether there is ground.

    Raises ProblemSetError where the set has no such task, or drpbench knows none of that name.
    """
    problem_set.task(task)
    if task not in TASKS:
        raise ProblemSetError(
            f"{problem_set.name} has problems of a task {task}, which drpbench does not know; "
            f"its tasks are {', '.join(TASKS)}"
        )
    return World(TASKS[task], problem_set.robot, sensor=SurfaceCloud(ground=problem_set.ground))


@pinned()
def run(request: Request, progress: RunProgress) -> Result:
    """Runs what is asked for, or what is left of it, and writes the result file.

    Raises PolicyError, WeightsError, ResultsError or ProblemSetError, before anything is simulated.
    """
    chosen = request.problem_set
    worlds = {task: world_of(chosen, task) for task in request.problems}
    asked = request.policy, request.policy_arguments, request.time_limit, chosen.robot
    if request.isolated:
        with isolated(*asked) as choice:
            return _run(request, choice, worlds, progress)
    return _run(request, request.choice or choose(*asked), worlds, progress)


def _run(
    request: Request, choice: Choice, worlds: Mapping[str, World], progress: RunProgress
) -> Result:
    chosen, policy = request.problem_set, choice.policy
    for task, ids in request.problems.items():
        chosen.task(task).require(ids or ())
    header = Header(
        protocol=PROTOCOL,
        policy=request.policy,
        name=request.name or _own_name(request.policy, choice),
        about=str(getattr(policy, "about", "")),
        policy_parameters={**choice.parameters},
        isolated=request.isolated,
        privileged=policy.privileged,
        tasks=list(request.problems),
        problem_set=chosen.name,
        problem_set_sha256=chosen.sha256,
        seed=request.seed,
        precision="float32",
        device=device_name(),
        processor=processor(),
        environment=environment(),
        batch_size=request.batch_size,
        versions=versions(),
        platform=platform.platform(),
        created=datetime.datetime.now(datetime.UTC).isoformat(),
        problems={
            task: None if ids is None else list(ids) for task, ids in request.problems.items()
        },
        wall_seconds=0.0,
        shard=request.shard,
    )
    begin = Journal.resume if request.resume else Journal.create
    with begin(request.out, header) as journal:
        if not journal.finished:
            trajectories = Trajectories(request.out) if request.save_trajectories else None
            for task, ids in request.problems.items():
                wanted = range(chosen.task(task).count) if ids is None else ids
                try:
                    _run_task(
                        request, policy, worlds[task], wanted, journal, trajectories, progress
                    )
                except PolicyError as error:  # it is gone for good: the rest is no verdict on it
                    raise PolicyError(f"{error}{KEPT}") from None
            if trajectories:
                trajectories.finish()
        return journal.finish()


def _own_name(policy: str, choice: Choice) -> str:
    """What a remote policy calls itself, with what stands over it; others are called as asked."""
    if not policy.startswith("remote:"):
        return ""
    stated = [v for key, v in choice.parameters.items() if key.split("policy.")[-1] == "remote"]
    return "+".join([*map(str, stated), *split(policy)[1]])


def _run_task(
    request: Request,
    policy: Policy | Hosted,
    world: World,
    wanted: Sequence[int],
    journal: Journal,
    trajectories: Trajectories | None,
    progress: RunProgress,
) -> None:
    task = world.task.name
    problems = request.problem_set.task(task)
    left = [id for id in wanted if (task, id) not in journal.done]
    batches = list(_batches(left, request.batch_size))
    progress.begin(task, len(batches) * world.episode.steps, len(wanted) - len(left))
    lanes = max(LANES, request.batch_size)
    rollout = Rollout(world, policy, request.seed, lanes)
    for ids in batches:
        began = time.perf_counter()
        trace = rollout.run(problems.take(ids), progress.advance)
        finished = rows_of(ids, [problems.family[id] for id in ids], trace)
        if trajectories:
            trajectories.add(task, ids, trace)
        seconds = time.perf_counter() - began
        if request.watch:
            request.watch(journal.header, task, ids, trace)
        journal.append(finished, seconds=seconds)
        progress.rows(finished)


def _batches(ids: Sequence[int], size: int) -> Iterator[list[int]]:
    for first in range(0, len(ids), size):
        yield list(ids[first : first + size])
