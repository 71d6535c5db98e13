"""The commands that look at a result file before others do. Everything heavy is imported inside."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from drpbench.errors import InputError

from .options import ProblemsFrom, check_out, set_of_results

if TYPE_CHECKING:
    from drpbench.evaluation.verification import Verification


def submit(
    results: Annotated[list[Path], typer.Argument(help="The result file, or one for each task.")],
) -> None:
    """Check a result fully, and say where it would rank. Nothing is sent anywhere.

    The exit code is 0 for a full entry, 1 if something is missing, and 2 for a file that is damaged
    or contradicts itself.
    """
    from drpbench.ranking import load_dir, render_entry
    from drpbench.ranking.submission import assess
    from drpbench.results import load
    from drpbench.results.shipped import shipped_results

    from .terminal import console_of, listing

    names = [str(path) for path in results]
    if len(set(names)) < len(names):
        raise InputError(f"a file is named twice: {' '.join(names)}")
    found = assess({name: load(name) for name in names}, load_dir(shipped_results()))
    places = [
        (standing.task, f"place {standing.place} of {standing.of}" + _behind(standing.ahead))
        for standing in found.standings
        if standing.place is not None
    ]
    console = console_of()
    console.print(render_entry(found.entry, console))
    sections = {
        "By success, among the shipped results": places or [("none", "no task is complete")],
        "Missing for a full entry": [_line(line) for line in found.missing] or [("nothing", "")],
    }
    console.print(listing(sections))
    for note in found.notes:
        console.print(f"Note: {note}", soft_wrap=True)
    raise typer.Exit(1 if found.missing else 0)


def _behind(ahead: str | None) -> str:
    return f", behind {ahead}" if ahead else ""


def _line(text: str) -> tuple[str, str]:
    """`FDO: 180 of 200 problems` as a name and what is said of it."""
    name, _, rest = text.partition(": ")
    return name, rest


def compare(
    first: Annotated[Path, typer.Argument(help="A result.")],
    second: Annotated[Path, typer.Argument(help="Another, on the same problems.")],
    most: Annotated[int, typer.Option(help="How many turned problems are listed.")] = 20,
) -> None:
    """Compare two runs problem by problem: which verdicts turned, and where to see it."""
    if most < 0:
        raise InputError(f"--most {most}: must not be negative; 0 lists none")
    from drpbench.ranking.compare import compared
    from drpbench.results import load

    from .terminal import console_of

    for line in compared({str(path): load(path) for path in (first, second)}, most):
        console_of().print(line, soft_wrap=True)


def difference(
    first: Annotated[Path, typer.Argument(help="A result, such as one on the public problems.")],
    second: Annotated[Path, typer.Argument(help="Another, such as one on a sealed set.")],
) -> None:
    """Print how much the success rates of two runs on different problems differ, by task.

    Each difference has Newcombe's 95 % interval. Runs on the same problems are compared in pairs by
    drpbench leaderboard.
    """
    from drpbench.ranking.sealed import differences
    from drpbench.results import load

    from .terminal import console_of

    lines = differences({str(path): load(path) for path in (first, second)})
    for line in lines:
        console_of().print(line, soft_wrap=True)


def merge(
    results: Annotated[list[Path], typer.Argument(help="The result files of all parts of a run.")],
    out: Annotated[Path, typer.Option(help="The file of the whole run; .json.gz compresses it.")],
    problems_from: ProblemsFrom = None,
) -> None:
    """Join the parts of a run that drpbench run --shard made, as if one run had made it."""
    from drpbench.results import load, save, shards
    from drpbench.results.names import forms

    check_out(out)
    if there := [form for form in forms(out) if form.exists()]:
        raise InputError(f"--out {there[0]}: exists; nothing overwritten. Name another file")
    parts = {str(path): load(path) for path in results}
    whole = shards.merged(parts, set_of_results(parts, problems_from).counts)
    save(whole, out)
    typer.echo(f"{len(whole.rows)} rows in {out}")


def verify(
    result: Annotated[Path, typer.Argument(help="The result file of a run.")],
    sample: Annotated[int, typer.Option(help="How many rows to run again.")] = 50,
    seed: Annotated[int, typer.Option(help="The seed that chooses the rows.")] = 0,
    problems_from: ProblemsFrom = None,
) -> None:
    """Run a random part of a result again, and compare row by row.

    The exit code is 0 if every verdict is the same, and 1 otherwise.
    """
    if sample < 1:
        raise InputError(f"--sample {sample}: must be at least 1")
    if seed < 0:
        raise InputError(f"--seed {seed}: must not be negative")
    from drpbench.results import load

    was = load(result)
    problem_set = set_of_results({str(result): was}, problems_from)
    from drpbench.compile import use_cache

    use_cache()
    from drpbench.evaluation import verification
    from drpbench.evaluation.progress import Bars

    from .terminal import console_of

    console = console_of()
    with Bars(console, was.header.policy) as progress:
        found = verification.verify(str(result), was, sample, seed, progress, problem_set)
    for line in _told(found):
        console.print(line, soft_wrap=True)
    raise typer.Exit(0 if found.reproduced else 1)


def _told(found: "Verification") -> list[str]:
    """What verifying showed, line by line."""
    lines = [f"{found.equal} of {found.rows} rows are equal in every field, to the bit"]
    fields: dict[str, list] = {}
    for difference in found.differences:
        fields.setdefault(difference.field, []).append(difference)
    for field, differences in fields.items():
        amounts = [d.amount for d in differences if d.amount is not None]
        most = f", by {max(amounts):.3g} at most" if amounts else ""
        lines.append(f"  {field} differs in {len(differences)}{most}")
    turned = sorted({(d.task, d.id) for d in found.turned})
    if found.reproduced:
        lines.append(f"every verdict is the same: {found.rows} of {found.rows}")
    else:
        lines.append(f"{len(turned)} of {found.rows} rows have another verdict:")
        lines += [f"  {d.task} {d.id}: {d.field} was {d.was}, is {d.now}" for d in found.turned]
    if found.differences:
        lines += [f"made elsewhere: {line}" for line in found.elsewhere]
        lines.append(
            "The same build of the program gives the same rows to the bit. Another one "
            "(another jax, processor or version) rounds differently in the seventh digit, and an "
            "arm that skirts obstacles amplifies it: between two builds, 3 of 200 FDO successes of "
            "rmp changed sides."
        )
    return lines
