"""Pictures of an environment's lanes, as `render_mode="rgb_array"` has them.

A picture of 640 x 480 pixels takes some 20 ms on a processor, as much as ten control steps of one
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
        state = jax.tree.map(lambda leaf: np.asarray(leaf[lane]), states)
        movers = state.movers
        now = Recording(
            world=self._world,
            id=int(state.problem.id),
            problem=state.problem,
            state=state,
            joint_position=state.joint_position[None],
            joint_velocity=state.joint_velocity[None],
            boxes=Boxes(
                half_size=movers.half_size[None],
                rotation=movers.rotation[None],
                position=movers.position[None],
                active=movers.active[None],
            ),
        )
        return self._stage.draw(now, motion(now), 0, clock * self._world.episode.period)

    def close(self) -> None:
        """Gives the drawing buffer back."""
        self._stage.close()
