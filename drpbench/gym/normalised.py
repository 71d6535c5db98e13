"""Observations whose numbers are around one in size, as wrappers of the environments."""

from collections.abc import Mapping
from typing import Any

import gymnasium
import numpy as np
from gymnasium.spaces import Box, Dict
from gymnasium.vector.utils import batch_space

from drpbench.robot import PANDA, Robot


def normalised(
    observation: Mapping[str, np.ndarray], robot: Robot = PANDA
) -> dict[str, np.ndarray]:
    """An observation, with any batch axes, whose joints are shares of what the arm can do.

    `joint_position` and `goal_joints` are -1 at the lower and 1 at the upper limit, and
    `joint_velocity` is 1 at the velocity limit. Everything else is around one in size as it is:
    places [m], quaternions, the mask.
    """
    middle = (robot.joint_lower + robot.joint_upper) / 2
    half = (robot.joint_upper - robot.joint_lower) / 2
    shares = {
        "joint_position": (observation["joint_position"] - middle) / half,
        "joint_velocity": observation["joint_velocity"] / robot.velocity_limit,
        "goal_joints": (observation["goal_joints"] - middle) / half,
    }
    return {**observation, **{name: share.astype(np.float32) for name, share in shares.items()}}


def _space(space: gymnasium.Space, robot: Robot) -> Dict:
    """Of normalised observations: its bounds are those of `space`, in their units."""
    assert isinstance(space, Dict)
    boxes: dict[str, Any] = dict(space.items())
    low = normalised({name: box.low for name, box in boxes.items()}, robot)
    high = normalised({name: box.high for name, box in boxes.items()}, robot)
    return Dict({name: Box(low[name], high[name], dtype=box.dtype) for name, box in boxes.items()})


class NormalisedObservations(gymnasium.ObservationWrapper):
    """`normalised` observations of one environment."""

    def __init__(self, env: gymnasium.Env, robot: Robot = PANDA):
        super().__init__(env)
        self._robot = robot
        self.observation_space = _space(env.observation_space, robot)

    def observation(self, observation: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        """The observation, normalised."""
        return normalised(observation, self._robot)


class NormalisedVectorObservations(gymnasium.vector.VectorWrapper):
    """`normalised` observations of a vector environment, the final ones of an episode among
    them."""

    def __init__(self, env: gymnasium.vector.VectorEnv, robot: Robot = PANDA):
        super().__init__(env)
        self._robot = robot
        self.single_observation_space = _space(env.single_observation_space, robot)
        self.observation_space = batch_space(self.single_observation_space, env.num_envs)

    def reset(
        self, *, seed: Any = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        """As the environment's, normalised."""
        observation, info = self.env.reset(seed=seed, options=options)
        return normalised(observation, self._robot), info

    def step(self, actions: Any) -> tuple[Any, ...]:
        """As the environment's, normalised."""
        observation, *outcome, info = self.env.step(actions)
        if "final_obs" in info:
            final = np.empty_like(info["final_obs"])
            for lane, ended in enumerate(info["final_obs"]):
                final[lane] = normalised(ended, self._robot)
            info = {**info, "final_obs": final}
        return normalised(observation, self._robot), *outcome, info
