"""The commands on problem sets: to look at them, export them and draw sealed ones."""

import os
from collections.abc import Iterable
from dataclasses import replace
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
    _require_new(out)
    _write(out, export_lines(problem_set, names))
    typer.echo(f"wrote {out}")


@problems_app.command("import")
def import_(
    path: Annotated[
        Path,
        typer.Argument(
            help="A folder of MoveIt's requests and scenes (MotionBenchMaker), or robometrics' YAML"
        ),
    ],
    out: Annotated[Path, typer.Option(help="The file of JSON lines to write.")],
    name: Annotated[
        str | None, typer.Option(help="What results call the set [default: the file's or folder's]")
    ] = None,
    finger_opening: Annotated[
        float | None,
        typer.Option(help="Of each finger from the middle, in metres [default: the set's own]"),
    ] = None,
    ground: Annotated[
        bool, typer.Option(help="Whether the arm stands on a table or floor at z = 0.")
    ] = False,
) -> None:
    """Take over problems of other projects, as a file that --problems-from reads.

    Nothing is overwritten. `drpbench problems check` says which of them are valid.
    """
    if finger_opening is not None and not 0.0 <= finger_opening <= 0.1:
        raise InputError(f"--finger-opening {finger_opening:g}: expected 0 to 0.1 m")
    _require_jsonl(out)
    _require_new(out)
    from drpbench.problems.formats import import_problems

    found = import_problems(path, name, finger_opening=finger_opening, ground=ground)
    _write(out, found.lines)
    families = ", ".join(f"{family} {count}" for family, count in found.families.items())
    typer.echo(f"wrote {out}: {found.families.total()} problems ({families})")
    for reason, count in found.left_out.items():
        typer.echo(f"left out: {count}, {reason}")
    if found.touching:
        typer.echo(f"{found.touching} goals touch something by the collision spheres")


@problems_app.command("check")
def check(
    path: Annotated[Path, typer.Argument(help="A file of JSON lines, as --problems-from reads.")],
    effort: Annotated[
        int, typer.Option(help="How many configurations are tried in search of a way.")
    ] = 100_000,
    out: Annotated[
        Path | None, typer.Option(help="Write the valid ones, with the ways found, to this file.")
    ] = None,
) -> None:
    """Say of each problem whether it is valid, and why not: both ends free, and a way between them.

    By the collision spheres, and by the arm's real meshes where they are at hand. Ends with 1 where
    a problem is not valid.
    """
    if effort < 1:
        raise InputError(f"--effort {effort}: must be at least 1")
    if out is not None:
        _require_jsonl(out)
        _require_new(out)
    from drpbench.generation.validity import Validity
    from drpbench.problems import export_lines, load_set

    problem_set = load_set(path)
    validity = Validity(problem_set.robot, effort)
    if not validity.by_meshes:
        typer.echo("by the collision spheres alone: the arm's real meshes are not at hand")
    kept, faults = {}, 0
    for task in problem_set.tasks:
        problems, ways = problem_set.task(task), {}
        for id in range(problems.count):
            way = validity.way(problems, id)
            if isinstance(way, str):
                faults += 1
                typer.echo(f"{task} {id} ({problems.family[id]}): {way}")
            else:
                ways[id] = way
        typer.echo(f"{task}: {len(ways)} of {problems.count} are valid")
        kept[task] = problems.with_ways(ways)
    if out is not None:
        valid = replace(problem_set, problems={t: p for t, p in kept.items() if p.count})
        if not valid.problems:
            raise InputError(f"{path}: no valid problem; nothing written")
        _write(out, export_lines(valid))
        typer.echo(f"wrote {out}")
    if faults:
        raise typer.Exit(1)


def _require_jsonl(out: Path) -> None:
    if out.suffix != ".jsonl":
        raise InputError(f"--out {out}: the problem set must end in .jsonl")


def _require_new(out: Path) -> None:
    if out.exists():
        raise InputError(f"{out}: exists; nothing overwritten. Name another file with --out")


def _write(out: Path, lines: Iterable[str]) -> None:
    """A new file, whole or not at all."""
    half = out.with_name(f".{out.name}.half")
    try:
        half.write_text("".join(f"{line}\n" for line in lines), encoding="utf-8")
        half.rename(out)
    except OSError as error:
        half.unlink(missing_ok=True)
        raise InputError(f"{out}: cannot be written ({error.strerror})") from None


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
    _require_jsonl(out)
    from drpbench.generation import sealed

    from .terminal import DataProgress, console_of

    secret, wanted = sealed.secret_of(seed_file), sealed.counts(count)
    total = sum(wanted.values())
    with DataProgress(console_of(), total, ("drawn", "certified")) as progress:
        sealed.draw(
            out, secret, wanted, workers or os.cpu_count() or 1, lambda n: progress.advance(n, n)
        )
    typer.echo(f"wrote {out}: {total} problems, {sealed.name_of(secret)}; keep {seed_file} secret")
