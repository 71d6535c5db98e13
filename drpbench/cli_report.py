"""The command that writes a report. Everything heavy is imported inside."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from drpbench.refused import Refused

if TYPE_CHECKING:
    from drpbench.evaluation import Result

THUMBNAILS = 12


def report(
    folder: Annotated[
        Path | None, typer.Argument(help="Folder of result files [default: the shipped results]")
    ] = None,
    out: Annotated[Path, typer.Option(help="The HTML file to write.")] = Path("report.html"),
    thumbnails: Annotated[
        int | None,
        typer.Option(
            help="Pictures of so many failures of each policy; what has no saved trajectories is run "
            f"again. [default: {THUMBNAILS}, of what has them]"
        ),
    ] = None,
) -> None:
    """Write one HTML file on results: leaderboard, charts, failures. A report that is there is replaced."""
    if out.suffix.lower() not in (".html", ".htm"):
        raise Refused(f"--out {out}: the report must end in .html")
    if thumbnails is not None and thumbnails < 0:
        raise Refused(f"--thumbnails {thumbnails}: must not be negative; 0 is none")
    from drpbench.evaluation.leaderboard import build, load_dir
    from drpbench.evaluation.shipped import shipped_results
    from drpbench.problems import counts
    from drpbench.recording.report import write_report

    if folder is None:
        folder, here = shipped_results(), Path.cwd()
        folder = folder.relative_to(here) if folder.is_relative_to(here) else folder
    results = load_dir(folder)
    expected = counts()
    build(results, expected)  # what cannot stand side by side is refused before anything is drawn
    pictures = _pictures(results, folder, thumbnails)
    write_report(out, results, expected, folder, pictures)
    typer.echo(f"wrote {out}")


def _pictures(
    results: Mapping[str, "Result"], folder: Path, thumbnails: int | None
) -> Mapping[tuple[str, str, int], str]:
    from drpbench.evaluation.result_names import trajectories_file

    saved = any(trajectories_file(folder / name).is_file() for name in results)
    if thumbnails == 0 or (thumbnails is None and not saved):
        return {}
    from rich.console import Console

    from drpbench.compile import use_cache
    from drpbench.recording import RecordingError
    from drpbench.recording.report_pictures import pictures

    use_cache()
    console = Console()

    def remark(told: str) -> None:
        console.print(told, style="yellow", highlight=False, soft_wrap=True)

    again, count = thumbnails is not None, THUMBNAILS if thumbnails is None else thumbnails
    with console.status("drawing") as status:
        try:
            return pictures(results, folder, count, again, remark, status.update)
        except RecordingError as error:
            if again:
                raise
            remark(f"a report without pictures: {error}")
            return {}
