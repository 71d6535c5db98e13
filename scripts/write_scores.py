"""Writes the scores of the shipped results into README.md (success) and docs/scores.md (all of it).

    python scripts/write_scores.py

The text between the lines `<!-- scores -->` and `<!-- end of scores -->` is replaced.
"""

from pathlib import Path

from drpbench.problems import load_set
from drpbench.ranking import build, load_dir
from drpbench.ranking.markdown import render_markdown
from drpbench.results.shipped import shipped_results

ROOT = Path(__file__).parents[1]
BEGIN, END = "<!-- scores -->\n", "<!-- end of scores -->"


def with_scores(page: str, scores: str) -> str:
    """The page with `scores` between its two marks."""
    before, rest = page.split(BEGIN)
    return f"{before}{BEGIN}\n{scores.strip()}\n\n{END}{rest.split(END)[1]}"


def main() -> None:
    everything = render_markdown(build(load_dir(shipped_results()), load_set().counts))
    success = "\n\n".join(everything.split("\n\n")[1:3])  # the first measure and its table
    for name, scores in {"README.md": success, "docs/scores.md": everything}.items():
        page = ROOT / name
        page.write_text(with_scores(page.read_text(), scores))


if __name__ == "__main__":
    main()
