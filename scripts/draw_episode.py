"""Draws an episode at several instants, side by side: docs/episode.png.

python scripts/draw_episode.py [--task FDO] [--id 18] [--out docs/episode.png]
"""

import argparse
from pathlib import Path

import numpy as np
from PIL import Image

from drpbench.compile import use_cache
from drpbench.envs import TASKS, World
from drpbench.plugins.registry import choose
from drpbench.problems import load_set
from drpbench.recording import motion, traced
from drpbench.recording.stage import Stage
from drpbench.rollout import Rollout

SIZE = (480, 400)  # [pixels] of one instant


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--task", default="FDO")
    parser.add_argument("--id", type=int, default=18)
    parser.add_argument("--policy", default="straight")
    parser.add_argument("--steps", type=int, nargs="+", default=[60, 240, 380])
    parser.add_argument("--out", type=Path, default=Path("docs/episode.png"))
    arguments = parser.parse_args()
    use_cache()
    problems = load_set().task(arguments.task)
    rollout = Rollout(World(TASKS[arguments.task]), choose(arguments.policy).policy)
    trace = rollout.run(problems.take([arguments.id]))
    episode = traced(arguments.id, problems, 0, trace, 0)
    moved, stage = motion(episode), Stage(*SIZE, episode.world.robot, real=False)
    pictures = [stage.draw(episode, moved, step + 1) for step in arguments.steps]
    stage.close()
    # 128 colours are enough, and a quarter of the bytes.
    sheet = Image.fromarray(np.hstack(pictures)).quantize(128, dither=Image.Dither.NONE)
    sheet.save(arguments.out, optimize=True)


if __name__ == "__main__":
    main()
