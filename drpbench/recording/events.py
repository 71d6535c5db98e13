"""What happened in an episode, in words."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from .episode import Recording
from .motion import Motion

_JUMP = 0.01  # [m] a box that moved more in a control step was put elsewhere


@dataclass(frozen=True)
class Event:
    """Something that happened at an instant; `bad` if it costs the success."""

    instant: int
    text: str
    bad: bool = False


def put_down(episode: Recording) -> np.ndarray:
    """(N, M) bool: whether a box appears at the instant, or is put elsewhere; at the start, whether
    it is there."""
    boxes = episode.boxes
    new = np.array(boxes.active)
    step = np.linalg.norm(np.diff(boxes.position, axis=0), axis=-1)
    resized = (np.diff(boxes.half_size, axis=0) != 0.0).any(axis=-1)
    new[1:] &= ~boxes.active[:-1] | (step > _JUMP) | resized
    return new


def events(episode: Recording, motion: Motion) -> list[Event]:
    """Boxes that appear and vanish, contacts, the goal; in the order of time."""
    found = [*_boxes(episode), *_contacts(motion), *_goal(motion)]
    return sorted(found, key=lambda event: event.instant)


def _boxes(episode: Recording) -> Iterator[Event]:
    boxes = episode.boxes
    for instant, box in np.argwhere(put_down(episode)):
        edges = " x ".join(f"{2.0 * half:.2f}" for half in boxes.half_size[instant, box])
        place = ", ".join(f"{x:.2f}" for x in boxes.position[instant, box])
        yield Event(int(instant), f"box {box} of {edges} m at ({place}) m")
    for instant, box in np.argwhere(boxes.active[:-1] & ~boxes.active[1:]):
        yield Event(int(instant) + 1, f"box {box} is gone")


def _contacts(motion: Motion) -> Iterator[Event]:
    for first, last in _spells(motion.touching):
        name = motion.robot.link_names[motion.link[first]]
        yield Event(first, f"collision: {name} touches an obstacle", bad=True)
        if last < len(motion.touching):
            depth = -1e3 * motion.clearance[first:last].min()
            yield Event(last, f"contact ends; it was {depth:.1f} mm deep")


def _goal(motion: Motion) -> Iterator[Event]:
    for first, last in _spells(motion.at_goal):
        yield Event(first, "at the goal: within 1 cm and 15 degrees")
        if last < len(motion.position_error):
            yield Event(last, "left the goal")


def _spells(on: np.ndarray) -> Iterator[tuple[int, int]]:
    """First instant of each run of true values, and the one after its last."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], on, [False]]).astype(int)))
    yield from ((int(a), int(b)) for a, b in edges.reshape(-1, 2))
