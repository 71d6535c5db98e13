"""The command that writes a report. Everything heavy is imported inside."""

from pathlib import Path
from typing import Annotated

import typer

from drpbench.refused import Refused


def report(
    folder: Annotated[
        Path | None, typer.Argument(help="Folder of result files [default: the shipped results]")
    ] = None,
    out: Annotated[Path, typer.Option(help="The HTML file to write.")] = Path("report.html"),
) -> None:
    """Write one HTML file on results: leaderboard, charts, failures. A report that is there is replaced."""
    if out.suffix.lower() not in (".html", ".htm"):
        raise Refused(f"--out {out}: the report must end in .html")
    from drpbench.evaluation.leaderboard import load_dir
    from drpbench.evaluation.shipped import shipped_results
    from drpbench.problems import counts
    from drpbench.recording.report import write_report

    if folder is None:
        folder, here = shipped_results(), Path.cwd()
        folder = folder.relative_to(here) if folder.is_relative_to(here) else folder
    write_report(out, load_dir(folder), counts(), folder)
    typer.echo(f"wrote {out}")
