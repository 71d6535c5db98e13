"""The command that runs a policy. Everything heavy is imported inside."""

from collections import Counter
from collections.abc import Sequence
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from drpbench.cli import recording as cli_recording
from drpbench.errors import InputError, suggested

from .options import (
    PolicyArguments,
    PolicyName,
    ProblemsFrom,
    Seed,
    TimeLimit,
    check_limits,
    check_out,
    given_set,
    parse_tasks,
)

if TYPE_CHECKING:
    from drpbench.problems import TaskProblems


def parse_problems(
    text: str | None, task: str, count: int, among: Sequence[int] | None = None
) -> list[int] | None:
    """Ids from `20` (the first so many), `3,17` or `0-9`; None for all of them.

    Families, pairs and levels take turns from one id to the next, so the first ones are a fair
    sample; every tenth one would be of half of the families. `among` are those to choose from.
    """
    if text is None or text == "all":
        return None if among is None else list(among)
    there = range(count) if among is None else among
    try:
        if text.isdecimal():
            wanted = int(text)
            if not 0 < wanted <= len(there):
                raise InputError(
                    f"--problems {text}: {task} has 1 to {len(there)} problems to choose from"
                )
            return None if wanted == count else list(there[:wanted])
        ids: list[int] = []
        for part in text.rstrip(",").split(","):
            first, _, last = part.partition("-")
            ids += range(int(first), int(last or first) + 1)
    except ValueError as error:
        if isinstance(error, InputError):
            raise
        raise InputError(
            f"--problems {text!r}: expected a count (20), ids (3,17 or 5,) or a range of ids (0-9)"
        ) from None
    if not ids or len(set(ids)) < len(ids):
        raise InputError(f"--problems {text!r}: names no problem, or one twice")
    if outside := [i for i in ids if not 0 <= i < count]:
        raise InputError(
            f"--problems: no problem {outside[0]} in {task}; ids go from 0 to {count - 1}"
        )
    if other := [i for i in ids if i not in there]:
        raise InputError(f"--problems: problem {other[0]} of {task} is not of the kind asked for")
    return ids


def matching(
    problems: "TaskProblems", family: str | None, pair: str | None, level: int | None
) -> list[int] | None:
    """The ids of a task's problems of a family, pair and level; None where none is asked for."""
    asked = {"family": family, "pair": pair, "level": level}
    asked = {name: value for name, value in asked.items() if value is not None}
    if not asked:
        return None
    for name, value in asked.items():
        there = sorted({str(one) for one in getattr(problems, name)})
        if str(value) not in there:
            raise InputError(
                f"--{name} {value}: {problems.task} has {', '.join(there)}"
                f"{suggested(str(value), there)}"
            )
    found = [
        id
        for id in range(problems.count)
        if all(str(getattr(problems, name)[id]) == str(value) for name, value in asked.items())
    ]
    if not found:
        told = ", ".join(f"{name} {value}" for name, value in asked.items())
        raise InputError(f"{problems.task} has no problem of {told} at once")
    return found


def default_out(policy: str, tasks: str, resume: bool) -> Path:
    """`runs/rmp-FDO.json`, or the first of `runs/rmp-FDO-2.json`, ... that no earlier run has.

    `tasks` are what the file is named after besides. To resume, the latest that is unfinished, be
    it to end plain or compressed.
    """
    from drpbench.results.names import forms, log_file

    policy = policy.replace("/", "_").replace(":", "-")  # a policy may name a file or a module
    names = [Path("runs") / f"{policy}-{tasks}.json"]
    while any(form.exists() for form in forms(names[-1])):
        names.append(Path("runs") / f"{policy}-{tasks}-{len(names) + 1}.json")
    if resume:
        unfinished = [form for name in names for form in forms(name) if log_file(form).exists()]
        return (unfinished or names)[-1]
    return names[-1]


def run(
    task: Annotated[
        str | None,
        typer.Option(
            help="The tasks: one, several (FDO,DGB) or all [default: 20 problems of each]"
        ),
    ] = None,
    policy: PolicyName = "rmp",
    policy_arg: PolicyArguments = None,
    time_limit: TimeLimit = 10.0,
    problems: Annotated[
        str | None, typer.Option(help="How many of each task, or which: 20, 3,17 or 0-9.")
    ] = None,
    problems_from: ProblemsFrom = None,
    seed: Seed = 0,
    out: Annotated[
        Path | None,
        typer.Option(
            help="The result file; .json.gz compresses it [default: runs/POLICY-TASK.json]"
        ),
    ] = None,
    name: Annotated[
        str, typer.Option(help="What the leaderboard calls the run [default: its policy]")
    ] = "",
    family: Annotated[
        str | None, typer.Option(help="Only problems of this scene family: shelf.")
    ] = None,
    pair: Annotated[
        str | None, typer.Option(help="Only problems of this kind of start and goal: tt.")
    ] = None,
    level: Annotated[int | None, typer.Option(help="Only problems of this level.")] = None,
    isolated: Annotated[
        bool,
        typer.Option(
            "--isolated", help="Keep the policy in a process that does not keep the score."
        ),
    ] = False,
    shard: Annotated[
        str | None,
        typer.Option(
            help="Run one part of the problems: 3/16, or slurm for SLURM's array variables; "
            "drpbench merge joins the parts."
        ),
    ] = None,
    resume: Annotated[bool, typer.Option("--resume", help="Continue an unfinished run.")] = False,
    batch_size: Annotated[
        int | None, typer.Option(help="How many episodes run at once [default: 64; 2048 on a GPU]")
    ] = None,
    save_trajectories: Annotated[
        bool,
        typer.Option("--save-trajectories", help="Write what moved to an NPZ beside the result."),
    ] = False,
    record: Annotated[
        str | None,
        typer.Option(
            metavar="[COUNT]",
            help="Write an MCAP file for Foxglove of every episode, or of COUNT of each task.",
        ),
    ] = None,
) -> None:
    """Evaluate a policy. Every problem runs exactly once; the result file has a row for each."""
    if batch_size is not None and batch_size < 1:
        raise InputError(f"--batch-size {batch_size}: must be at least 1")
    check_limits(time_limit, seed)
    recorded = cli_recording.parse_count(record)
    from drpbench.problems import load_set
    from drpbench.results import shards

    problem_set = given_set(problems_from) or load_set()
    names, sizes = parse_tasks(task or "all", problem_set), problem_set.counts
    if task is None and problems is None and sum(sizes.values()) > 20 * len(sizes):
        problems = "20"
        typer.echo(f"20 problems of each task; --task all runs all {sum(sizes.values())}")
    wanted: dict[str, list[int] | None] = {}
    for one in names:
        of_kind = matching(problem_set.task(one), family, pair, level)
        wanted[one] = parse_problems(problems, one, sizes[one], of_kind)
    part = ""
    if shard is not None:
        number, parts = shards.parse(shard)
        wanted |= shards.share(wanted, sizes, number, parts)
        part = f"{number}/{parts}"
    tag = "all" if len(names) == len(sizes) else "-".join(names)
    if problems_from is not None:
        tag = f"{problem_set.name.replace('/', '_')}-{tag}"
    if part:
        tag += f"-shard-{part.replace('/', '-of-')}"
    out = out or default_out(policy, tag, resume)
    check_out(out)
    told = ", ".join(f"{len(ids or range(sizes[one]))} {one}" for one, ids in wanted.items())
    typer.echo(f"{policy} on {told}; the first batch of each task compiles first")

    from drpbench.compile import use_cache

    use_cache()
    import jax

    from drpbench.evaluation import Request
    from drpbench.evaluation import run as run_request
    from drpbench.evaluation.progress import Bars
    from drpbench.ranking import build, render_entry
    from drpbench.rollout import LANES

    from .terminal import console_of

    default = LANES if jax.default_backend() == "cpu" else 2048
    console = console_of()
    progress = Bars(console, policy)
    recorder = None
    if record:
        recorder = cli_recording.recorder(out, recorded, wanted, problem_set, progress)
    request = Request(
        policy=policy,
        policy_arguments=policy_arg or (),
        time_limit=time_limit,
        problems=wanted,
        out=out,
        problem_set=problem_set,
        seed=seed,
        name=name,
        isolated=isolated,
        shard=part,
        batch_size=batch_size or default,
        resume=resume,
        save_trajectories=save_trajectories,
        watch=recorder.watch if recorder else None,
    )
    with progress, recorder or nullcontext():
        result = run_request(request, progress)
    console.print(render_entry(build({out.name: result}, sizes).entries[0], console))
    failures = Counter(row.status for row in result.rows if row.status != "ok")
    for status, count in failures.most_common():
        console.print(f"{count} of {len(result.rows)} failed: {status}")
    console.print(f"{len(result.rows)} rows in {out}", soft_wrap=True)
    if record:
        from drpbench.results.names import recordings_folder

        console.print(f"recordings in {recordings_folder(out)}", soft_wrap=True)
    failed = [found for found in result.rows if found.valid and not found.success]
    if failed:
        first = failed[0]
        of = f" --task {first.task}" if len(names) > 1 else ""
        also = f"drpbench replay {out}{of} --id {first.id} --video shows a failure; "
    else:
        also = ""
    where = f" {out.parent}" if str(out.parent) != "." else " ."
    then = f"drpbench leaderboard{where} compares"
    if part:
        then = "drpbench merge joins the parts once all of them are there"
    console.print(f"next: {also}{then}", soft_wrap=True)
