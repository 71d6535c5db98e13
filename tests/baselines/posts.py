"""A way of the hand about the base, and posts that stand on it."""

import jax.numpy as jnp
import numpy as np

from drpbench.contract import OBSERVED, HostObservation
from drpbench.geometry import BOX, Primitives
from drpbench.robot import PANDA

from ..scenes import observation

START = np.asarray(PANDA.home, np.float32)
GOAL = START + np.float32([1.4, 0, 0, 0, 0, 0, 0])
AWAY = float(jnp.hypot(*PANDA.grip_pose(PANDA.link_poses(jnp.asarray(START)))[0][:2]))
"""[m] of the hand from the base's axis"""


def post(bearing):
    """A post where the hand passes at this bearing [rad]."""
    return Primitives(
        kind=np.array([BOX]),
        half_size=np.array([[0.03, 0.03, 0.35]], np.float32),
        position=np.array([[AWAY * np.cos(bearing), AWAY * np.sin(bearing), 0.35]], np.float32),
        rotation=np.eye(3, dtype=np.float32)[None],
        mask=np.ones(1, bool),
    )


def batch(*bearings):
    """One instance for each bearing of a post."""
    one = observation(jnp.asarray(START), jnp.asarray(GOAL))
    posts = [post(bearing) for bearing in bearings]
    arrays = {name: np.stack([np.asarray(getattr(one, name))] * len(posts)) for name in OBSERVED}
    names = ("kind", "half_size", "position", "rotation", "mask")
    scenes = Primitives(**{n: np.stack([getattr(p, n) for p in posts]) for n in names})
    return HostObservation(obstacles=scenes, **arrays)
