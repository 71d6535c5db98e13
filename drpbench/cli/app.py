"""The command line: thin, one function a command. Everything heavy is imported inside."""

import io
import os
import sys
from collections import Counter
from collections.abc import Sequence
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from drpbench.cli import learning as cli_learning
from drpbench.cli import recording as cli_recording
from drpbench.cli import report as cli_report
from drpbench.cli import results as cli_results
from drpbench.cli import view as cli_view
from drpbench.errors import DrpbenchError, InputError

if TYPE_CHECKING:
    from drpbench.problems import TaskProblems

from .options import (
    PolicyArguments,
    PolicyName,
    ProblemsFrom,
    Seed,
    TimeLimit,
    check_limits,
    given_set,
    one_task,
    parse_tasks,
    set_of_results,
)

app = typer.Typer(
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    help="Does a manipulator policy survive a moving world?",
)
problems_app = typer.Typer(
    no_args_is_help=True, help="Look at the problems of a set, or export them."
)
app.add_typer(problems_app, name="problems")


def main() -> None:
    """Entry point. Bad input ends in one line on stderr and exit code 2, and nothing is
    overwritten."""
    for stream in (sys.stdout, sys.stderr):
        # A terminal that knows few letters shows a question mark, and the command goes on.
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")
    try:
        app(cli_recording.with_all(at_home(sys.argv[1:])))
    except KeyboardInterrupt:
        again = {"run": "; go on with --resume", "train": "; go on with --resume"}
        again |= dict.fromkeys(("data", "correct"), "; the same command goes on where it stopped")
        told = again.get(next(iter(sys.argv[1:]), ""), "")
        print(f"\ndrpbench: interrupted{told}", file=sys.stderr)
        sys.exit(130)
    except DrpbenchError as error:
        print(f"drpbench: {error}", file=sys.stderr)
        sys.exit(2)
    except BrokenPipeError:  # whoever reads has read enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(1)
    except OSError as error:
        where = f"{error.filename}: " if error.filename else ""
        kept = "; the rows so far are kept" if sys.argv[1:2] == ["run"] else ""
        print(f"drpbench: {where}{(error.strerror or str(error)).lower()}{kept}", file=sys.stderr)
        sys.exit(2)


def at_home(arguments: Sequence[str]) -> list[str]:
    """`--out=~/x.json` as the shell has it after a space: with the user's folder in it."""
    found = []
    for argument in arguments:
        name, equals, value = argument.partition("=")
        expands = name.startswith("--") and equals and value[:1] == "~"
        found.append(f"{name}={os.path.expanduser(value)}" if expands else argument)
    return found


def _show_version(wanted: bool) -> None:
    if wanted:
        from drpbench import __version__

        typer.echo(f"drpbench {__version__}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool,
        typer.Option(
            "--version", is_eager=True, callback=_show_version, help="Show the version and exit."
        ),
    ] = False,
) -> None:
    pass


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
            raise InputError(f"--{name} {value}: {problems.task} has {', '.join(there)}")
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


@app.command()
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
    from drpbench.results.names import is_result

    problem_set = given_set(problems_from) or load_set()
    names, sizes = parse_tasks(task or "all", problem_set), problem_set.counts
    if task is None and problems is None and sum(sizes.values()) > 20 * len(sizes):
        problems = "20"
        typer.echo(f"20 problems of each task; --task all runs all {sum(sizes.values())}")
    wanted = {}
    for one in names:
        of_kind = matching(problem_set.task(one), family, pair, level)
        wanted[one] = parse_problems(problems, one, sizes[one], of_kind)
    tag = "all" if len(names) == len(sizes) else "-".join(names)
    if problems_from is not None:
        tag = f"{problem_set.name.replace('/', '_')}-{tag}"
    out = out or default_out(policy, tag, resume)
    if not is_result(out):
        raise InputError(f"--out {out}: the result file must end in .json or .json.gz")
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
    recorder = None
    if record:
        recorder = cli_recording.recorder(out, recorded, wanted, problem_set)
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
        batch_size=batch_size or default,
        resume=resume,
        save_trajectories=save_trajectories,
        watch=recorder.watch if recorder else None,
    )
    console = console_of()
    with recorder or nullcontext(), Bars(console, policy) as progress:
        result = run_request(request, progress)
    console.print(render_entry(build({out.name: result}, sizes).entries[0]))
    failures = Counter(row.status for row in result.rows if row.status != "ok")
    for status, count in failures.most_common():
        console.print(
            f"{count} of {len(result.rows)} failed: {status}", highlight=False, markup=False
        )
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
    console.print(f"next: {also}drpbench leaderboard{where} compares", soft_wrap=True)


@app.command()
def leaderboard(
    folder: Annotated[
        Path | None, typer.Argument(help="A folder of result files [default: the shipped results]")
    ] = None,
    format: Annotated[
        str, typer.Option("--format", help="How to print it: table, markdown, csv or json.")
    ] = "table",
    measure: Annotated[
        list[str] | None,
        typer.Option(
            help="What a table shows, repeatable: success, reached, collided, by_deadline, light, "
            "clean, reached_5cm [default: success, by_deadline, collided, reached]"
        ),
    ] = None,
    protocol: Annotated[
        int | None,
        typer.Option(help="The version of the protocol [default: the newest of the results]"),
    ] = None,
    alone: Annotated[
        bool, typer.Option("--alone", help="Leave the shipped results out beside a folder's.")
    ] = False,
    problems_from: ProblemsFrom = None,
) -> None:
    """Compare results. Every figure is recomputed from the rows and has a 95 % interval."""
    from drpbench.ranking import build, export, load_dir
    from drpbench.ranking.board import beside
    from drpbench.ranking.markdown import render_markdown
    from drpbench.ranking.measures import MEASURES
    from drpbench.results.shipped import shipped_results

    texts = {"markdown": render_markdown, "csv": export.as_csv, "json": export.as_json}
    if format not in ("table", *texts):
        raise InputError(f"--format {format}: expected table, {', '.join(texts)}")
    known = [name for name, _ in MEASURES]
    if unknown := [name for name in measure or () if name not in known]:
        raise InputError(f"--measure {unknown[0]}: expected one of {', '.join(known)}")
    results = load_dir(folder if folder is not None else shipped_results())
    if folder is not None and not alone:
        results |= beside(results, load_dir(shipped_results()))
    board = build(results, set_of_results(results, problems_from).counts, protocol)
    if format in texts:
        print(texts[format](board), end="")
        return
    from drpbench.ranking.tables import SHORT, render_terminal, width_needed

    from .terminal import console_of

    console, wanted = console_of(), measure or SHORT
    if not console.is_terminal:
        console.width = max(console.width, width_needed(board, wanted))
    console.print(render_terminal(board, console, wanted))


@app.command("list")
def list_() -> None:
    """List the tasks and the policies."""
    from drpbench.envs import TASKS
    from drpbench.plugins.imported import installed
    from drpbench.plugins.registry import POLICIES, WRAPPERS
    from drpbench.problems import load_set

    from .terminal import console_of, listing

    sizes = load_set().counts
    tasks = [(name, f"{task.title}, {sizes[name]} problems") for name, task in TASKS.items()]
    policies = [(name, about) for name, (_, about) in POLICIES.items()]
    policies += [(name, f"installed: {entry.value}") for name, entry in installed().items()]
    policies += [("module:Class", "yours, by import path (docs/your-policy.md)")]
    policies += [(f"…+{name}", about) for name, (_, about) in WRAPPERS.items()]
    console_of().print(listing({"Tasks": tasks, "Policies": policies}))


@app.command("new-policy")
def new_policy(
    name: Annotated[str, typer.Argument(help="The policy's name: my-policy")],
    folder: Annotated[
        Path, typer.Option(help="The folder that the package's folder goes into.")
    ] = Path("."),
) -> None:
    """Write a small package for a policy of your own. It runs as it is."""
    from drpbench.plugins.registry import POLICIES, WRAPPERS
    from drpbench.plugins.scaffold import write

    for path in write(name, folder, frozenset({*POLICIES, *WRAPPERS, "remote"})):
        typer.echo(f"wrote {path}")
    typer.echo(
        f"next: pip install -e {folder / name} && "
        f"drpbench run --task FDO --problems 20 --policy {name}"
    )


@problems_app.command("show")
def show(
    task: Annotated[str, typer.Argument(help="The task: FDO")],
    id: Annotated[int, typer.Argument(help="The problem's number: 17")],
    problems_from: ProblemsFrom = None,
) -> None:
    """Print one problem."""
    from drpbench.problems import load_set, to_json

    from .terminal import console_of, problem_card

    problem_set = given_set(problems_from) or load_set()
    problems = problem_set.task(one_task(task, problem_set))
    console_of().print(problem_card(to_json(problems, id)))


@problems_app.command("export")
def export(
    task: Annotated[str, typer.Option(help="The tasks: one, several or all.")],
    out: Annotated[Path, typer.Option(help="The file of JSON lines to write.")],
    problems_from: ProblemsFrom = None,
) -> None:
    """Write problems as JSON lines, which --problems-from reads. Nothing is overwritten."""
    from drpbench.problems import export_lines, load_set

    problem_set = given_set(problems_from) or load_set()
    names = parse_tasks(task, problem_set)
    if out.exists():
        raise InputError(f"{out}: exists; nothing overwritten. Name another file with --out")
    try:
        with open(out, "x", encoding="utf-8") as file:
            file.writelines(f"{line}\n" for line in export_lines(problem_set, names))
    except OSError as error:
        raise InputError(f"{out}: cannot be written ({error.strerror})") from None
    typer.echo(f"wrote {out}")


@problems_app.command("draw")
def draw(
    seed_file: Annotated[
        Path, typer.Option(help="A file of at least 16 secret bytes: head -c 32 /dev/urandom.")
    ],
    out: Annotated[Path, typer.Option(help="The file of JSON lines to write.")],
    count: Annotated[
        int | None,
        typer.Option(help="How many of each task at most [default: as many as drpbench-v1 has]"),
    ] = None,
    workers: Annotated[
        int | None, typer.Option(help="How many processes draw [default: one a core]")
    ] = None,
) -> None:
    """Draw a sealed problem set: the benchmark's families and numbers, from a secret.

    The same command continues where it stopped. Run a policy on it with --problems-from.
    """
    if count is not None and count < 1:
        raise InputError(f"--count {count}: must be at least 1")
    if workers is not None and workers < 1:
        raise InputError(f"--workers {workers}: must be at least 1")
    if out.suffix != ".jsonl":
        raise InputError(f"--out {out}: the problem set must end in .jsonl")
    from drpbench.generation import sealed

    from .terminal import DataProgress, console_of

    secret, wanted = sealed.secret_of(seed_file), sealed.counts(count)
    total = sum(wanted.values())
    with DataProgress(console_of(), total, ("drawn", "certified")) as progress:
        sealed.draw(
            out, secret, wanted, workers or os.cpu_count() or 1, lambda n: progress.advance(n, n)
        )
    typer.echo(f"wrote {out}: {total} problems, {sealed.name_of(secret)}; keep {seed_file} secret")


@app.command()
def doctor() -> None:
    """Print versions and device, and test the verdict: it must see every link in every shape."""
    from drpbench.compile import use_cache

    use_cache()
    from drpbench.evaluation import examine

    from .terminal import console_of, diagnosis

    report = examine()
    console_of().print(diagnosis(report))
    if not report.healthy:
        raise typer.Exit(1)


@app.command()
def referee(
    result: Annotated[
        Path, typer.Argument(help="The result file of a run with --save-trajectories.")
    ],
    problems_from: ProblemsFrom = None,
) -> None:
    """Judge recorded episodes again, in C MuJoCo with the real meshes, and compare the verdicts."""
    from rich.progress import track

    from drpbench.evaluation.referee import agreement, judgements
    from drpbench.results import load
    from drpbench.results.names import trajectories_file
    from drpbench.results.trajectories import load_trajectories

    from .terminal import console_of, listing

    run = load(result)
    recorded = trajectories_file(result)
    if not recorded.is_file():
        raise InputError(f"{recorded}: not there; run again with --save-trajectories")
    try:
        trajectories = load_trajectories(recorded)
    except ValueError as error:
        raise InputError(str(error)) from None
    console = console_of()
    problem_set = set_of_results({str(result): run}, problems_from)
    judging = judgements(run, trajectories, problem_set)
    figures = agreement(
        list(track(judging, "judging", len(run.rows), console=console, transient=True))
    )
    console.print(listing(figures.summary()))


app.command()(cli_learning.correct)
app.command()(cli_learning.data)
app.command()(cli_learning.train)
app.command()(cli_recording.replay)
app.command()(cli_report.report)
app.command()(cli_results.submit)
app.command()(cli_results.verify)
app.command()(cli_results.compare)
app.command()(cli_results.difference)
app.command()(cli_view.view)


if __name__ == "__main__":
    main()
