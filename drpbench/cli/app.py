"""The command line: thin, one function a command. Everything heavy is imported inside."""

import io
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer

from drpbench.cli import learning as cli_learning
from drpbench.cli import problems as cli_problems
from drpbench.cli import recording as cli_recording
from drpbench.cli import report as cli_report
from drpbench.cli import results as cli_results
from drpbench.cli import running as cli_running
from drpbench.cli import view as cli_view
from drpbench.errors import DrpbenchError, InputError, suggested

from .options import (
    ProblemsFrom,
    set_of_results,
    shipped_beside,
)

app = typer.Typer(
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    help="Does a manipulator policy survive a moving world?",
)
app.add_typer(cli_problems.problems_app, name="problems")


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
        typer.Option(
            help="The version of the protocol [default: the newest of which there is a whole run]"
        ),
    ] = None,
    alone: Annotated[
        bool, typer.Option("--alone", help="Leave the shipped results out beside a folder's.")
    ] = False,
    problems_from: ProblemsFrom = None,
) -> None:
    """Compare results. Every figure is recomputed from the rows and has a 95 % interval."""
    from drpbench.ranking import build, export, load_dir
    from drpbench.ranking.markdown import render_markdown
    from drpbench.ranking.measures import MEASURES
    from drpbench.results.shipped import shipped_results

    texts = {"markdown": render_markdown, "csv": export.as_csv, "json": export.as_json}
    if format not in ("table", *texts):
        raise InputError(f"--format {format}: expected table, {', '.join(texts)}")
    known = [name for name, _ in MEASURES]
    if unknown := [name for name in measure or () if name not in known]:
        raise InputError(
            f"--measure {unknown[0]}: expected one of {', '.join(known)}"
            f"{suggested(unknown[0], known)}"
        )
    results = load_dir(folder if folder is not None else shipped_results())
    sizes = set_of_results(results, problems_from).counts
    if folder is not None and not alone:
        results |= shipped_beside(results, sizes, protocol)
    board = build(results, sizes, protocol)
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


app.command()(cli_running.run)
app.command()(cli_learning.correct)
app.command()(cli_learning.data)
app.command()(cli_learning.train)
app.command()(cli_recording.replay)
app.command()(cli_report.report)
app.command()(cli_results.submit)
app.command()(cli_results.verify)
app.command()(cli_results.compare)
app.command()(cli_results.merge)
app.command()(cli_results.difference)
app.command()(cli_view.view)


if __name__ == "__main__":
    main()
