"""The command that writes a report. Everything heavy is imported inside."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from drpbench.errors import InputError

from .extras import require
from .options import ProblemsFrom, set_of_results, shipped_beside

if TYPE_CHECKING:
    from drpbench.problems import ProblemSet
    from drpbench.results import Result

THUMBNAILS = 12


def report(
    folder: Annotated[
        Path | None, typer.Argument(help="A folder of result files [default: the shipped results]")
    ] = None,
    out: Annotated[Path, typer.Option(help="The HTML file to write.")] = Path("report.html"),
    thumbnails: Annotated[
        int | None,
        typer.Option(
            help="How many failures of each policy are drawn; what has no saved trajectories "
            f"is run again. [default: {THUMBNAILS}, of what has them]"
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
    """Write one HTML file on results, with charts and failures. An older report is replaced."""
    require("record", "drpbench report")
    if out.suffix.lower() not in (".html", ".htm"):
        raise InputError(f"--out {out}: the report must end in .html")
    if thumbnails is not None and thumbnails < 0:
        raise InputError(f"--thumbnails {thumbnails}: must not be negative; 0 is none")
    from drpbench.ranking import build, load_dir
    from drpbench.ranking.board import of_protocol
    from drpbench.report.page import write_report
    from drpbench.results.shipped import shipped_results

    own = folder is not None
    if folder is None:
        folder, here = shipped_results(), Path.cwd()
        folder = folder.relative_to(here) if folder.is_relative_to(here) else folder
    results = load_dir(folder)
    problem_set = set_of_results(results, problems_from)
    expected = problem_set.counts
    shown = of_protocol(results, expected, protocol)
    others = shipped_beside(results, expected, protocol) if own and not alone else {}
    # What cannot stand side by side is refused before anything is drawn.
    build(results | others, expected, protocol)
    pictures = _pictures(shown, folder, thumbnails, problem_set)
    write_report(out, results | others, expected, folder, pictures, protocol)
    typer.echo(f"wrote {out}")


def _pictures(
    results: Mapping[str, "Result"],
    folder: Path,
    thumbnails: int | None,
    problem_set: "ProblemSet",
) -> Mapping[tuple[str, str, int], str]:
    from drpbench.results.names import trajectories_file

    saved = any(trajectories_file(folder / name).is_file() for name in results)
    if thumbnails == 0 or (thumbnails is None and not saved):
        return {}
    from drpbench.compile import use_cache
    from drpbench.recording import RecordingError
    from drpbench.report.pictures import pictures

    from .terminal import console_of

    use_cache()
    console = console_of()

    def remark(told: str) -> None:
        console.print(told, style="yellow", soft_wrap=True)

    again, count = thumbnails is not None, THUMBNAILS if thumbnails is None else thumbnails
    with console.status("drawing") as status:
        try:
            return pictures(results, folder, count, again, remark, status.update, problem_set)
        except RecordingError as error:
            if again:
                raise
            remark(f"a report without pictures: {error}")
            return {}
