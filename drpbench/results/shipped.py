"""Where the results that come with drpbench lie."""

from pathlib import Path


def shipped_results() -> Path:
    """The folder of shipped results: inside the installed package, or `results/` of a checkout."""
    room = Path(__file__).parent
    installed = room / "shipped"
    return installed if installed.is_dir() else room.parents[1] / "results"
