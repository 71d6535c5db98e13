"""Films an episode for the first screen of the README: docs/drpbench.webp.

python scripts/draw_readme.py [--task DGB] [--id 61] [--policy drp] [--out docs/drpbench.webp]
"""

import argparse
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from PIL import Image

from drpbench.compile import use_cache
from drpbench.envs import TASKS, World
from drpbench.plugins.registry import choose
from drpbench.problems import load_set
from drpbench.recording import Recording, motion, traced
from drpbench.recording.camera import CAMERAS
from drpbench.recording.stage import Stage
from drpbench.rollout import Rollout

SIZE, DRAWN = (640, 400), (1280, 840)  # [pixels] of the film; drawn larger, for smooth edges
CAPTION = 40  # [pixels] at the top of what is drawn, cut off: too small to read in the film
STRIDE, SPEED = 8, 2.0  # control steps a frame; times true speed
LAST = 790  # control step; the boxes are gone and nothing moves any more
PAUSE = 1.2  # [s] that the last frame stays


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--task", default="DGB")
    parser.add_argument("--id", type=int, default=61)
    parser.add_argument("--policy", default="drp")
    parser.add_argument("--out", type=Path, default=Path("docs/drpbench.webp"))
    arguments = parser.parse_args()
    use_cache()
    problems = load_set().task(arguments.task)
    rollout = Rollout(World(TASKS[arguments.task]), choose(arguments.policy).policy)
    trace = rollout.run(problems.take([arguments.id]))
    write(arguments.out, traced(arguments.id, problems, 0, trace, 0))


def write(path: Path, episode: Recording) -> None:
    """Writes an animated WebP of the episode up to the control step LAST."""
    pictures = list(frames(episode))
    each = round(1000 * STRIDE * episode.world.episode.period / SPEED)  # [ms]
    pictures[0].save(
        path,
        save_all=True,
        append_images=pictures[1:],
        duration=[each] * (len(pictures) - 1) + [round(1000 * PAUSE)],
        loop=0,
        quality=70,
        method=4,
    )


def frames(episode: Recording) -> Iterator[Image.Image]:
    """The film's frames: the camera stands nearer than the video's."""
    moved, stage = motion(episode), Stage(*DRAWN, episode.world.robot, real=False)
    stage.aim(replace(CAMERAS["corner"], distance=1.75, at=(0.25, 0.0, 0.45)))
    for instant in range(0, LAST + 1, STRIDE):
        picture = Image.fromarray(stage.draw(episode, moved, instant)[CAPTION:])
        yield picture.resize(SIZE, Image.Resampling.LANCZOS)
    stage.close()


if __name__ == "__main__":
    main()
