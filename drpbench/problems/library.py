"""Where problem sets are found: by the name of one that comes with the package, or in a file."""

from __future__ import annotations

from pathlib import Path

from .frozen import DATA, installed, read_frozen
from .lines import read_lines
from .problem_set import ProblemSet
from .task_problems import ProblemSetError

PROBLEM_SET = "drpbench-v1"
"""The benchmark's set: the one that runs and leaderboards are of unless another is named."""


def load_set(name: str | Path = PROBLEM_SET, folder: Path = DATA) -> ProblemSet:
    """A set that comes with the package, by its name, or one in a file, by its path (see `lines`).

    Raises ProblemSetError where there is none, and for damaged data.
    """
    if Path(name).is_file():
        return read_lines(Path(name))
    if str(name) in installed(folder):
        return read_frozen(str(name), folder)
    there = ", ".join(installed(folder)) or "none"
    raise ProblemSetError(
        f"there is no problem set {str(name)!r}, neither installed ({there}) nor as a file"
    )


def matching(name: str, sha256: str, given: ProblemSet | None = None) -> ProblemSet:
    """The set that a result names: `given`, or the one of that name that comes with the package.

    Raises ProblemSetError where it is not the one that the checksum is of.
    """
    if given is None and name not in installed():
        raise ProblemSetError(
            f"the problem set {name} does not come with drpbench; name its file with "
            f"--problems-from"
        )
    found = load_set(name) if given is None else given
    if found.sha256 != sha256:
        raise ProblemSetError(
            f"made on {name} with checksum {sha256[:12]}...; "
            f"the problems here are {found.name} with checksum {found.sha256[:12]}..."
        )
    return found
