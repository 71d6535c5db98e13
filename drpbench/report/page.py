"""A report on results: one HTML file that needs nothing else, for reading, not for scoring again.

Its tables stand in the HTML itself; its charts and the list of failures are drawn by a script of
ours from embedded counts (:mod:`drpbench.report.figures`). Whatever a result file says is escaped,
and the page's content security policy allows this one script and no connection.
"""

import base64
import hashlib
import json
import os
import re
import sys
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from importlib.resources import files
from pathlib import Path
from types import MappingProxyType

from drpbench.ranking import Leaderboard, build, measures
from drpbench.ranking.board import Cell, Entry, file_of, labelled, of_protocol
from drpbench.ranking.measures import ABSENT, ALL, MEASURES, PAIRED, percent
from drpbench.results import Result, ResultsError
from drpbench.results.names import recordings_folder

from .figures import figures
from .recordings import Instance, Kept, kept

NONE: Mapping = MappingProxyType({})


def write_report(
    path: str | os.PathLike[str],
    results: Mapping[str, Result],
    expected: Mapping[str, int],
    folder: str | os.PathLike[str] = "",
    pictures: Mapping[Instance, str] = NONE,
    protocol: int | None = None,
) -> None:
    """Writes the report on results, whole or not at all. It links to recordings that lie beside
    them.

    Args:
        path: the HTML file; it is replaced.
        results: by file name.
        expected: number of problems of each task, in the order the tasks are shown.
        folder: where the files lie, for the commands that replay an episode.
        pictures: of failures, as `data:` addresses (`report_pictures.pictures`).
        protocol: its version, as for `drpbench.ranking.build`.

    Raises:
        LeaderboardError: the results cannot stand side by side.
        ResultsError: the file cannot be written.
    """
    path, folder = Path(path), Path(folder)
    beside = {name: kept(recordings_folder(file_of(folder, name)), path.parent) for name in results}
    page = render(results, expected, folder, beside, pictures, protocol)
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            temporary.write_text(page, encoding="utf-8")
            os.replace(temporary, path)
        finally:
            temporary.unlink(missing_ok=True)
    except OSError as error:
        raise ResultsError(f"{path}: cannot be written ({error.strerror})") from None


def render(
    results: Mapping[str, Result],
    expected: Mapping[str, int],
    folder: str | os.PathLike[str] = "",
    recordings: Mapping[str, Kept] = NONE,
    pictures: Mapping[Instance, str] = NONE,
    protocol: int | None = None,
) -> str:
    """The page's HTML; `recordings` by file name, other arguments and errors as those of
    `write_report`."""
    board = build(results, expected, protocol)
    results = labelled(of_protocol(results, expected, board.protocol))
    style, script, template = (_source(f"report.{kind}") for kind in ("css", "js", "html"))
    # Between script tags only `<` has a meaning, and JSON may write it as an escape.
    drawn = figures(board, results, Path(folder), recordings, pictures)
    data = json.dumps(drawn, separators=(",", ":"))
    parts = {
        "policy": "; ".join(
            (
                "default-src 'none'",
                f"script-src '{_digest(script)}'",
                f"style-src '{_digest(style)}'",
                "img-src data:",
                "base-uri 'none'",
                "form-action 'none'",
            )
        ),
        "style": style,
        "script": script,
        "data": data.replace("<", "\\u003c"),
        "summary": _summary(board, results),
        "leaderboard": "\n".join(_leaderboard(board)),
        "runs": _runs(results),
    }
    # One pass: what is put in is not searched for places again.
    return re.sub(r"\{\{(\w+)\}\}", lambda place: parts[place[1]], template)


def _source(name: str) -> str:
    return files("drpbench.report").joinpath(name).read_text(encoding="utf-8")


def _digest(text: str) -> str:
    """What a content security policy calls this script or style."""
    return "sha256-" + base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()


def _summary(board: Leaderboard, results: Mapping[str, Result]) -> str:
    rows = sum(len(result.rows) for result in results.values())
    left_out = sum(entry.overall.left_out for entry in board.entries)
    text = (
        f"{_many(len(board.entries), 'policy', 'policies')}, {_many(rows, 'episode', 'episodes')} "
        f"on {escape(board.problem_set)} (sha256 {board.problem_set_sha256[:12]}), "
        f"protocol {board.protocol}."
    )
    if left_out:
        text += f" {left_out:,} episodes stand in no figure: no box came in them."
    return text


def _many(count: int, one: str, more: str) -> str:
    return f"{count:,} {one if count == 1 else more}"


def _leaderboard(board: Leaderboard) -> Iterable[str]:
    columns = measures.columns(board.tasks)
    for measure, title in MEASURES:
        if not measures.shown(measure, board.entries):
            continue
        opened = " open" if measure == "success" else ""
        head = _row("th", ["#", "Policy", *columns], ["", "", *columns])
        body = "\n".join(_entry(entry, columns, measure) for entry in board.entries)
        yield (
            f'<details class="measure"{opened}><summary>{escape(title)}</summary>'
            f"{_table('sortable', title, head, body)}</details>"
        )
    if len(board.entries) > 1:
        yield f"<details><summary>{escape(PAIRED)}</summary>{_paired(board)}</details>"
    for note in measures.notes(board.entries) + measures.others(board):
        yield f'<p class="note">{escape(note)}</p>'


def _entry(entry: Entry, columns: Sequence[str], measure: str) -> str:
    cells = [
        _rate(entry.overall if column == ALL else entry.cells.get(column), column, measure)
        for column in columns
    ]
    name = escape(entry.policy) + ("†" if entry.privileged else "")
    place = sys.maxsize if entry.rank is None else entry.rank  # a partial run sorts last
    return (
        f'<tr data-policy="{escape(entry.policy)}"><td data-value="{place}">'
        f'{measures.rank(entry)}</td><th scope="row">{name}</th>{"".join(cells)}</tr>'
    )


def _rate(cell: Cell | None, column: str, measure: str) -> str:
    rate = None if cell is None else getattr(cell, measure)
    if cell is None or rate is None or not rate.n:
        return f'<td data-task="{column}" data-value="-1">{ABSENT}</td>'
    low, high = rate.interval
    return (
        f'<td data-task="{column}" data-value="{rate.share:.6f}">'
        f"<b>{percent(rate.share)}{'*' if cell.partial else ''}</b> "
        f"<small>[{percent(low)}, {percent(high)}]<br>{rate.k}/{rate.n}</small></td>"
    )


def _paired(board: Leaderboard) -> str:
    head = _row("th", measures.PAIRED_HEAD)
    lines = [_row("td", line) for line in measures.paired_lines(board) if line[-1] != ABSENT]
    return _table("", PAIRED, head, "\n".join(lines))


def _runs(results: Mapping[str, Result]) -> str:
    heads = [
        "File",
        "Policy",
        "Protocol",
        "Tasks",
        "Rows",
        "Seed",
        "Device",
        "Batch",
        "Made",
        "Parameters",
    ]
    lines = []
    for name, result in results.items():
        header = result.header
        cells = [
            name,
            header.policy,
            str(header.protocol),
            " ".join(header.tasks),
            f"{len(result.rows):,}",
            str(header.seed),
            f"{header.device}, {header.precision}",
            str(header.batch_size),
            f"{header.created[:16].replace('T', ' ')} UTC, "
            f"{header.wall_seconds:.0f}\N{NO-BREAK SPACE}s",
        ]
        parameters = "; ".join(f"{key} {value}" for key, value in header.policy_parameters.items())
        versions = "; ".join(f"{key} {value}" for key, value in header.versions.items())
        told = f"{escape(header.about)}</p><p>{escape(parameters)}</p><p>{escape(versions)}"
        details = f"<details><summary>show</summary><p>{told}</p></details>"
        line = _row("td", cells)
        lines.append(line.removesuffix("</tr>") + f"<td>{details}</td></tr>")
    return _table("runs", "The runs", _row("th", heads), "\n".join(lines))


def _row(kind: str, texts: Sequence[str], tasks: Sequence[str] | None = None) -> str:
    scope = ' scope="col"' if kind == "th" else ""
    marks = [f' data-task="{escape(t)}"' if t else "" for t in tasks or [""] * len(texts)]
    cells = (f"<{kind}{scope}{m}>{escape(t)}</{kind}>" for t, m in zip(texts, marks, strict=True))
    return f"<tr>{''.join(cells)}</tr>"


def _table(kind: str, title: str, head: str, body: str) -> str:
    # The frame scrolls sideways on a phone; it takes the focus so that keys can scroll it.
    return (
        f'<div class="frame" role="region" aria-label="{escape(title)}" tabindex="0">'
        f'<table class="{kind}"><thead>{head}</thead><tbody>\n{body}\n</tbody></table></div>'
    )
