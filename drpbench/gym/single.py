"""The environment of one problem: `gymnasium.make("drpbench/FDO-v1")`."""

from typing import Any

import gymnasium
import numpy as np
from jaxtyping import Array, Num

from drpbench.contract import EPISODE, Episode
from drpbench.problems import ProblemSet

from .vector import VectorEnv


class SingleEnv(gymnasium.Env):
    """A vector environment of one lane, without the axis of lanes. See `VectorEnv` for what it
    means."""

    metadata = {
        name: value for name, value in VectorEnv.metadata.items() if name != "autoreset_mode"
    }

    def __init__(
        self,
        *,
        task: str,
        problems: str | range | ProblemSet = "frozen",
        run_seed: int = 0,
        episode: Episode = EPISODE,
        reward: str = "sparse",
        control_mode: str = "absolute",
        render_mode: str | None = None,
    ):
        self._one = VectorEnv(
            1,
            task=task,
            problems=problems,
            run_seed=run_seed,
            episode=episode,
            reward=reward,
            control_mode=control_mode,
            render_mode=render_mode,
        )
        self.render_mode = render_mode
        self.metadata = {**self.metadata, "render_fps": self._one.metadata["render_fps"]}
        self.observation_space = self._one.single_observation_space
        self.action_space = self._one.single_action_space

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        """Begins an episode. `options={"id": 17}` names its problem, else `seed` sets the order.

        Raises:
            ValueError: an option is unknown, or names no problem.
        """
        super().reset(seed=seed)
        observation, info = self._one.reset(seed=seed, options=options)
        return _first(observation), _plain(info)

    def step(
        self, action: Num[np.ndarray, "..."] | Num[Array, "..."]
    ) -> tuple[dict[str, np.ndarray], float, bool, bool, dict[str, Any]]:
        """One control step, 1/60 s, towards joint targets (J,) [rad].

        Raises:
            ValueError: the action is not of shape (J,).
            RuntimeError: the episode is over, or none was begun.
        """
        targets = np.asarray(action, np.float32)
        if targets.shape != self.action_space.shape:
            raise ValueError(f"the action has shape {targets.shape}, not {self.action_space.shape}")
        observation, reward, _, truncated, info = self._one.step(targets[None])
        return _first(observation), float(reward[0]), False, bool(truncated[0]), _plain(info)

    def render(self) -> np.ndarray | None:
        """A picture (480, 640, 3) uint8, or None without a render mode. See `VectorEnv.render`."""
        pictures = self._one.render()
        return None if pictures is None else pictures[0]

    def close(self) -> None:
        """Gives the drawing buffer back."""
        self._one.close()


def _first(observation: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    return {name: values[0] for name, values in observation.items()}


def _plain(info: dict[str, Any]) -> dict[str, Any]:
    return {name: values[0].item() for name, values in info.items() if not name.startswith("_")}
