"""Pictures of an environment's lanes, as `render_mode="rgb_array"` has them.

A picture of 640 x 480 pixels takes some 40 ms on a processor, as much as many control steps of one
lane: it is drawn when it is asked for.
"""

import jax
import numpy as np

from drpbench.envs import State, World
from drpbench.recording.episode import Boxes, Recording
from drpbench.recording.motion import motion
from drpbench.recording.offscreen import choose_platform
from drpbench.recording.stage import Stage

SIZE = (640, 480)  # [pixels] width, height


class Picture:
    """Draws lanes of one world. Raises RecordingError where nothing can be drawn."""

    def __init__(self, world: World):
        choose_platform()
        self._world = world
        self._stage = Stage(*SIZE, world.robot)

    def draw(self, states: State, lane: int, clock: int) -> np.ndarray:
        """The picture (480, 640, 3) uint8 of a lane, `clock` control steps after its episode
        began."""
        state = jax.tree.map(lambda leaf: leaf[lane], states)
        movers = {
            name: np.asarray(getattr(state.movers, name))[None]
            for name in ("half_size", "rotation", "position", "active")
        }
        now = Recording(
            world=self._world,
            id=int(state.problem.id),
            problem=state.problem,
            state=state,
            joint_position=np.asarray(state.joint_position)[None],
            joint_velocity=np.asarray(state.joint_velocity)[None],
            boxes=Boxes(**movers),
        )
        return self._stage.draw(now, motion(now), 0, clock * self._world.episode.period)

    def close(self) -> None:
        """Gives the drawing buffer back."""
        self._stage.close()
