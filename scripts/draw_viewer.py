"""Draws the viewer's page with a box dragged at the arm: docs/viewer.png. Needs viser and Chromium.

python scripts/draw_viewer.py [--task FDO] [--id 18] [--out docs/viewer.png]
"""

import argparse
import runpy
import tempfile
import threading
import time
from pathlib import Path

import numpy as np
from PIL import Image

from drpbench.compile import use_cache
from drpbench.envs import TASKS, World
from drpbench.plugins.registry import choose
from drpbench.problems import load_set
from drpbench.viewer import Simulation
from drpbench.viewer.page import Page

BROWSER = Path(__file__).parents[1] / "tests" / "browser.py"
SIZE = (1200, 720)  # [pixels]
ASIDE = 0.35  # [m] from which the box comes at the forearm


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--task", default="FDO")
    parser.add_argument("--id", type=int, default=18)
    parser.add_argument("--policy", default="straight+dcp-rmp")
    parser.add_argument("--steps", type=int, default=90)
    parser.add_argument("--out", type=Path, default=Path("docs/viewer.png"))
    arguments = parser.parse_args()
    use_cache()
    policy = choose(arguments.policy).policy
    simulation = Simulation(World(TASKS[arguments.task]), policy, load_set().task(arguments.task))
    for _ in simulation.compile(arguments.id):
        pass
    for _ in range(arguments.steps):
        simulation.step()
    box = simulation.add_box()
    wrist = simulation.look().arm[0][7]
    simulation.move("piece", box, wrist + [ASIDE, 0.0, 0.0])
    simulation.step()
    simulation.move("piece", box, wrist, at_once=False)
    for _ in range(8):
        simulation.step()
    page = Page(simulation, arguments.policy, "127.0.0.1", 8080)
    thread = threading.Thread(target=page.run)
    thread.start()
    try:
        shot = _photograph(page.address)
    finally:
        page.close()
        thread.join()
    # 200 colours are enough, and a third of the bytes.
    shot.quantize(200, dither=Image.Dither.NONE).save(arguments.out, optimize=True)


def _photograph(address: str) -> Image.Image:
    browser = runpy.run_path(str(BROWSER))["Browser"]
    with tempfile.TemporaryDirectory() as folder, browser(Path(folder)) as opened:
        opened.screen(*SIZE)
        opened("Page.navigate", url=address)
        path, before = Path(folder) / "page.png", None
        for _ in range(60):  # until it changes no more
            time.sleep(2.0)
            # viser warns of rendering without a GPU; that is this picture's business alone.
            opened.js(
                "document.querySelectorAll('.mantine-Notification-closeButton').forEach(b => "
                "b.click())"
            )
            opened.screenshot(path)
            shot = np.asarray(Image.open(path).convert("RGB"))
            if before is not None and np.array_equal(shot, before) and len(np.unique(shot)) > 150:
                break
            before = shot
    return Image.fromarray(shot)


if __name__ == "__main__":
    main()
