"""The recordings that lie beside results, for a report to link to."""

import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from urllib.parse import quote

from drpbench.recording.recorded import is_whole

KINDS = (".mp4", ".webp", ".mcap")
"""What `drpbench replay` and `drpbench run --record` write, first what a browser can show."""

_EPISODE, _GRID = re.compile(r"([A-Z]+)-(\d{5,})"), re.compile(r"[A-Z]+-grid-\d+")

Instance = tuple[str, str, int]
"""A result's file name, the task, and the instance's id."""


@dataclass(frozen=True)
class Kept:
    """The recordings in the folder that is named after a result file."""

    address: str = ""
    """The folder's, relative to the report's, so that both can be moved together."""
    episodes: Mapping[tuple[str, int], Sequence[int]] = field(default_factory=dict)
    """By task and id: which of KINDS there are."""
    grids: Sequence[str] = ()
    """File names of videos of many episodes."""


def kept(folder: Path, page: Path) -> Kept:
    """What lies in a folder of recordings, for a report in the folder `page`; nothing if there is
    none.

    MCAP files that were cut short are left out.
    """
    if not folder.is_dir():
        return Kept()
    episodes: dict[tuple[str, int], list[int]] = {}
    grids = []
    for kind, suffix in enumerate(KINDS):
        for path in sorted(folder.glob(f"*{suffix}")):
            if suffix == ".mcap" and not is_whole(path):
                continue
            if found := _EPISODE.fullmatch(path.stem):
                episodes.setdefault((found[1], int(found[2])), []).append(kind)
            elif _GRID.fullmatch(path.stem):
                grids.append(path.name)
    relative = Path(os.path.relpath(folder.resolve(), page.resolve()))
    return Kept(quote(relative.as_posix()), episodes, grids)


def gallery(
    files: Sequence[str],
    failed: Sequence[Instance],
    recordings: Mapping[str, Kept],
    pictures: Mapping[Instance, str],
) -> dict:
    """What there is to see of failures, as plain values for JSON.

    Args:
        files: names of all result files.
        failed: the failures, in the order of the report's columns.
        recordings: by file name.
        pictures: `data:` addresses.

    Returns:
        `kinds`; of each file the `folders` of recordings and the `grids` in them; `kept`, pairs of
            a failure's place and the indices of its kinds; `pictures`, pairs of its place and its
            picture.
    """
    beside = [recordings.get(file, Kept()) for file in files]
    by_file = dict(zip(files, beside, strict=True))
    found = [by_file[file].episodes.get((task, id)) for file, task, id in failed]
    return {
        "kinds": KINDS,
        "folders": [each.address for each in beside],
        "grids": [list(each.grids) for each in beside],
        "kept": [[place, list(kinds)] for place, kinds in enumerate(found) if kinds],
        "pictures": [
            [place, pictures[instance]]
            for place, instance in enumerate(failed)
            if instance in pictures
        ],
    }
