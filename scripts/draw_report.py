"""Draws the top of the report on the shipped results as a browser shows it: docs/report.png.

python scripts/draw_report.py [--out docs/report.png]

It needs Chromium.
"""

import argparse
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from PIL import Image

from drpbench.problems import load_set
from drpbench.ranking import load_dir
from drpbench.report.page import write_report
from drpbench.results.shipped import shipped_results

NAMES = ("chromium", "chromium-browser", "google-chrome", "chrome")
WIDTH, HEIGHT = 1200, 1240  # [pixels]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--out", type=Path, default=Path("docs/report.png"))
    arguments = parser.parse_args()
    browser = next(filter(None, map(shutil.which, NAMES)), None)
    if browser is None:
        sys.exit(f"no Chromium on the PATH; looked for {', '.join(NAMES)}")
    with tempfile.TemporaryDirectory() as name:
        page, shot = Path(name) / "report.html", Path(name) / "report.png"
        write_report(page, load_dir(shipped_results()), load_set().counts, "results")
        options = ["--headless=new", "--no-sandbox", "--disable-gpu", "--hide-scrollbars"]
        options += [f"--user-data-dir={name}/profile", f"--window-size={WIDTH},{HEIGHT}"]
        command = [browser, *options, f"--screenshot={shot}", page.as_uri()]
        subprocess.run(command, check=True, timeout=120, capture_output=True)
        with Image.open(shot) as file:
            picture = file.convert("RGB")
    picture.save(arguments.out, optimize=True)


if __name__ == "__main__":
    main()
