"""A vector environment as stable-baselines3 wants one."""

from collections.abc import Sequence
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode

try:
    from stable_baselines3.common.vec_env import VecEnv
except ImportError:
    raise ImportError(
        "drpbench.gym.stable_baselines needs stable-baselines3: pip install 'drpbench[sb3]'",
        name="stable_baselines3",
    ) from None


class StableBaselinesVecEnv(VecEnv):
    """A Gymnasium vector environment, with its wrappers, for stable-baselines3's algorithms.

    `infos` are a dictionary a lane. In an episode's last step they hold `terminal_observation` and
    `TimeLimit.truncated`, as stable-baselines3 expects, and `is_success`, from which it logs
    `rollout/success_rate`.

    Args:
        envs: a vector environment that was made with `autoreset_mode="SameStep"`.

    Raises:
        ValueError: it begins its next episodes otherwise.
    """

    def __init__(self, envs: gymnasium.vector.VectorEnv):
        mode = envs.metadata.get("autoreset_mode")
        if mode is not AutoresetMode.SAME_STEP:
            found = getattr(mode, "value", mode)
            raise ValueError(
                "expected an environment made with autoreset_mode='SameStep', which is how "
                f"stable-baselines3 begins episodes, got {found!r}"
            )
        self.envs = envs
        self._actions: np.ndarray = np.zeros(0)
        super().__init__(envs.num_envs, envs.single_observation_space, envs.single_action_space)

    def reset(self) -> Any:
        """The first observations of new episodes; `seed` and `set_options` count for it."""
        options = self._options[0] or None
        observation, info = self.envs.reset(seed=self._seeds[0], options=options)
        self.reset_infos = self._by_lane(info)
        self._reset_seeds()
        self._reset_options()
        return observation

    def step_async(self, actions: np.ndarray) -> None:
        """Keeps the actions for `step_wait`."""
        self._actions = actions

    def step_wait(self) -> tuple[Any, np.ndarray, np.ndarray, list[dict[str, Any]]]:
        """Observations, rewards, which episodes ended, and a dictionary a lane."""
        observation, rewards, terminated, truncated, info = self.envs.step(self._actions)
        done = terminated | truncated
        if not done.any():
            return observation, rewards.astype(np.float32), done, self._by_lane(info)
        infos = self._by_lane(info["final_info"])
        for lane in np.flatnonzero(done):
            of = infos[lane]
            of["terminal_observation"] = info["final_obs"][lane]
            of["TimeLimit.truncated"] = bool(truncated[lane] and not terminated[lane])
            of["is_success"] = of["reached"] and not of["collided"] and of["finite"]
        return observation, rewards.astype(np.float32), done, infos

    def close(self) -> None:
        """Closes the environment."""
        self.envs.close()

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """The environment's attribute, once for each lane asked for."""
        value = getattr(self.envs, attr_name)
        return [value for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Raises NotImplementedError: one program steps all lanes, and they share its settings."""
        raise NotImplementedError(
            f"cannot set {attr_name!r}: make the environment with the setting that you want"
        )

    def env_method(
        self, method_name: str, *arguments: Any, indices: Any = None, **named: Any
    ) -> list[Any]:
        """What the environment's method returns, once for each lane asked for."""
        value = getattr(self.envs, method_name)(*arguments, **named)
        return [value for _ in self._get_indices(indices)]

    def env_is_wrapped(self, wrapper_class: type, indices: Any = None) -> list[bool]:
        """Whether the vector environment is within such a wrapper."""
        found, env = False, self.envs
        while isinstance(env, gymnasium.vector.VectorWrapper):
            found, env = found or isinstance(env, wrapper_class), env.env
        return [found for _ in self._get_indices(indices)]

    def get_images(self) -> Sequence[np.ndarray | None]:
        """A picture of each lane, or none where the environment was made without a render mode."""
        pictures: Any = self.envs.render()
        return [None] * self.num_envs if pictures is None else list(pictures)

    def _by_lane(self, info: dict[str, Any]) -> list[dict[str, Any]]:
        """Gymnasium's arrays by key as plain values by lane."""
        plain = {
            key: values.tolist()
            for key, values in info.items()
            if not key.startswith("_") and not key.startswith("final_")
        }
        return [
            {key: values[lane] for key, values in plain.items()} for lane in range(self.num_envs)
        ]
