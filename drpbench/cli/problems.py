"""The commands on problem sets: to look at them, export them and draw sealed ones."""

import os
from pathlib import Path
from typing import Annotated

import typer

from drpbench.errors import InputError

from .options import ProblemsFrom, given_set, one_task, parse_tasks

problems_app = typer.Typer(
    no_args_is_help=True, help="Look at the problems of a set, or export them."
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
