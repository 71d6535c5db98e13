"""Where the results that come with drpbench lie."""

from pathlib import Path


def shipped_results() -> Path:
    """The folder of shipped results: inside the installed package, or `results/` of a checkout."""
    package = Path(__file__).parents[1]
    installed = package / "results" / "shipped"
    return installed if installed.is_dir() else package.parent / "results"
