"""The vector environment: `gymnasium.make_vec("drpbench/FDO-v1", num_envs=64)`."""

import os
from dataclasses import replace
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space
from jaxtyping import Array, Num

from drpbench.contract import EPISODE, Episode
from drpbench.envs import TASKS
from drpbench.evaluation.run import world_of
from drpbench.problems import ProblemSet, load_set

from .lanes import Lanes, Outcome
from .picture import Picture
from .served import source
from .spaces import action_space, as_dict, observation_space

_PROCESS = os.getpid()
REWARDS = ("sparse", "dense")
CONTROL_MODES = ("absolute", "delta")
_RADIAN = 0.1  # [m/rad] what orientation weighs in the dense reward
_OPTIONS = ("id", "reset_mask")
_MEASURES = ("clearance", "position_error", "orientation_error")
_VERDICT = ("reached", "collided", "finite", "valid")


class VectorEnv(gymnasium.vector.VectorEnv):
    """One task, `num_envs` problems at once, in one compiled JAX program.

    Observations are dictionaries of arrays (`drpbench.gym.spaces`), actions absolute joint targets
    [rad] of shape (num_envs, J), J = 7 for the Panda. The reward is 1 for success at the last
    control step, and 0 otherwise: an episode's return is its success. Nothing terminates an episode
    before its 1000 control steps; then all lanes are truncated together, and `reset` begins the
    next problems, or the environment does, if `autoreset_mode` says so.

    The dense reward of step t adds what came nearer and takes away the first collision:

        r_t = e_(t-1) - e_t - [first collision in t] + [success, at the last step]
        e = position error [m] + 0.1 m/rad * orientation error [rad]

    so that an episode's return is the error it began with, less the one it ended with, less 1 for
    a collision, plus 1 for success.

    Args:
        num_envs: how many problems at once.
        task: SE, SAO, FDO, GB or DGB.
        problems: "frozen" for the benchmark's, "training" for others drawn to learn from, a range
            of the numbers of those, which are drawn once and kept, or a ProblemSet.
        run_seed: the seed of `drpbench run`: of point clouds and of how boxes move.
        episode: how long an episode is; another one than the benchmark's is for trying things out.
        reward: "sparse", the verdict at the last step; or "dense", see above.
        control_mode: "absolute" joint targets [rad], or "delta": actions within [-1, 1] are shares
            of the velocity limits, and the target lies as far ahead of each joint as the servos lag
            at that speed.
        autoreset_mode: who begins the next episodes: "Disabled", the caller; "NextStep", the step
            after the last one, whose actions count for nothing; "SameStep", the last step itself,
            with what it ended in as `info["final_obs"]` and `info["final_info"]`.
        render_mode: "rgb_array" to draw lanes with `render` (`drpbench.gym.picture`), or None.

    Raises:
        ValueError: an argument is not one of those.
    """

    metadata = {
        "render_modes": ["rgb_array"],
        "render_fps": round(1.0 / EPISODE.period),
        "autoreset_mode": AutoresetMode.DISABLED,
    }

    def __init__(
        self,
        num_envs: int = 1,
        *,
        task: str,
        problems: str | range | ProblemSet = "frozen",
        run_seed: int = 0,
        episode: Episode = EPISODE,
        reward: str = "sparse",
        control_mode: str = "absolute",
        autoreset_mode: str | AutoresetMode = AutoresetMode.DISABLED,
        render_mode: str | None = None,
    ):
        modes = [mode.value for mode in AutoresetMode]
        if getattr(autoreset_mode, "value", autoreset_mode) not in modes:
            expected = ", ".join(map(repr, modes))
            raise ValueError(f"autoreset_mode={autoreset_mode!r}: expected one of {expected}")
        self._autoreset = AutoresetMode(autoreset_mode)
        for name, value, choices in (
            ("reward", reward, REWARDS),
            ("control_mode", control_mode, CONTROL_MODES),
        ):
            if value not in choices:
                raise ValueError(f"{name}={value!r}: expected {' or '.join(map(repr, choices))}")
        self._dense, self._delta = reward == "dense", control_mode == "delta"
        if render_mode not in (None, "rgb_array"):
            raise ValueError(f"render_mode={render_mode!r}: expected 'rgb_array' or None")
        self.render_mode = render_mode
        if num_envs < 1:
            raise ValueError(f"num_envs={num_envs}: must be at least 1")
        if task not in TASKS:
            raise ValueError(f"no task {task!r}; there are: {', '.join(TASKS)}")
        if not -(2**31) <= run_seed < 2**31:
            raise ValueError(f"run_seed={run_seed}: must fit 32 bits")
        problem_set = problems if isinstance(problems, ProblemSet) else load_set()
        world = replace(world_of(problem_set, task), episode=episode)
        self.num_envs = num_envs
        self.metadata = {
            **self.metadata,
            "render_fps": round(1.0 / episode.period),
            "autoreset_mode": self._autoreset,
        }
        self.single_observation_space = observation_space(world.spec)
        self.single_action_space = (
            gymnasium.spaces.Box(-1.0, 1.0, (world.robot.joints,), np.float32)
            if self._delta
            else action_space(world.robot)
        )
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._problems = source(problem_set if problems == "frozen" else problems, world)
        self._lanes = Lanes(world, num_envs, run_seed, self._problems.stream)
        self._ids: list[int] = []
        self._picture: Picture | None = None

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        """Begins an episode in every lane.

        Args:
            seed: of the order in which problems are served; None goes on in the order begun.
            options: `{"id": [...]}` names the problem of each lane. `{"reset_mask": [...]}` may
                only be true everywhere, for all lanes' episodes begin and end together.

        Raises:
            ValueError: an option is unknown, or names no problem.
            RuntimeError: this process was forked from one that had imported drpbench.
        """
        _require_own_process()  # here, and not before: Gymnasium's workers pass this error on
        super().reset(seed=seed)
        ids = self._asked_for(options or {})
        if seed is not None:
            self._problems.restart()
        self._ids = self._problems.draw(self.np_random, self.num_envs) if ids is None else ids
        observation = self._lanes.begin(self._problems.take(self._ids))
        self._joints = np.asarray(observation.joint_position)
        self._collided = np.zeros(self.num_envs, bool)
        if self._dense:
            self._error = _error(*self._lanes.errors())
        return as_dict(observation), self._info()

    def step(
        self, actions: Num[np.ndarray, "..."] | Num[Array, "..."]
    ) -> tuple[dict[str, np.ndarray], np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """One control step, 1/60 s, in every lane.

        Raises:
            ValueError: actions are not of shape (num_envs, J).
            RuntimeError: the episodes are over, or none was begun.
        """
        if self._autoreset is AutoresetMode.NEXT_STEP and self._ids and self._lanes.over:
            begun, info = self.reset()
            still = np.zeros(self.num_envs, bool)
            return begun, np.zeros(self.num_envs), still, still.copy(), info
        targets = np.asarray(actions, np.float32)
        if targets.shape != self.action_space.shape:
            raise ValueError(f"actions have shape {targets.shape}, not {self.action_space.shape}")
        if self._delta:
            robot = self._lanes.world.robot
            ahead = np.clip(targets, -1.0, 1.0) * (robot.velocity_limit * robot.servo_lag)
            targets = (self._joints + ahead).astype(np.float32)
        observation, outcome = self._lanes.step(targets)
        self._joints = np.asarray(observation.joint_position)
        over = self._lanes.over
        reward = np.asarray(outcome.verdict.success, float) if over else np.zeros(self.num_envs)
        if self._dense:
            now = _error(np.asarray(outcome.position_error), np.asarray(outcome.orientation_error))
            collided = np.asarray(outcome.verdict.collided)
            reward = reward + self._error - now - (collided & ~self._collided)
            self._error, self._collided = now, collided
        terminated = np.zeros(self.num_envs, bool)
        truncated = np.full(self.num_envs, over)
        shown, info = as_dict(observation), self._info(outcome)
        if over and self._autoreset is AutoresetMode.SAME_STEP:
            final, ended = shown, info
            shown, info = self.reset()
            info |= self._final(final, ended)
        return shown, reward, terminated, truncated, info

    def _final(self, shown: dict[str, np.ndarray], info: dict[str, Any]) -> dict[str, Any]:
        """What episodes ended in, as Gymnasium has it: an observation a lane, infos by key."""
        lanes = np.empty(self.num_envs, object)
        for lane in range(self.num_envs):
            lanes[lane] = {name: values[lane] for name, values in shown.items()}
        ended = np.ones(self.num_envs, bool)
        return {
            "final_obs": lanes,
            "_final_obs": ended,
            "final_info": info,
            "_final_info": ended.copy(),
        }

    def render(self) -> tuple[np.ndarray, ...] | None:
        """A picture (480, 640, 3) uint8 of each lane, or None without a render mode.

        Raises:
            RecordingError: nothing can be drawn here.
            RuntimeError: no episode was begun.
        """
        if self.render_mode is None:
            return None
        states, clock = self._lanes.state, self._lanes.clock
        if self._picture is None:
            self._picture = Picture(self._lanes.world)
        return tuple(self._picture.draw(states, lane, clock) for lane in range(self.num_envs))

    def close_extras(self, **_: Any) -> None:
        """Gives the drawing buffer back."""
        if self._picture is not None:
            self._picture.close()
            self._picture = None

    def _asked_for(self, options: dict[str, Any]) -> list[int] | None:
        """The ids that the options name, one a lane."""
        if unknown := sorted(set(options) - set(_OPTIONS)):
            raise ValueError(f"no option {unknown[0]!r}; there are: {', '.join(_OPTIONS)}")
        if not np.all(options.get("reset_mask", True)):
            raise ValueError(
                "reset_mask is not true everywhere: all lanes share one clock, and their "
                "episodes end "
                f"together after {self._lanes.world.episode.steps} steps"
            )
        if "id" not in options:
            return None
        ids = np.asarray(options["id"])
        shapes = [(self.num_envs,), *([()] if self.num_envs == 1 else [])]
        if ids.shape not in shapes or not np.issubdtype(ids.dtype, np.integer):
            count = "a whole number" if self.num_envs == 1 else f"{self.num_envs} whole numbers"
            raise ValueError(
                f"id: expected {count}, one for each environment, got {options['id']!r}"
            )
        listed = ids.reshape(-1).tolist()
        self._problems.require(listed)
        return listed

    def _info(self, outcome: Outcome | None = None) -> dict[str, Any]:
        """As Gymnasium has it: an array a key, and beside it which lanes have that key."""
        info = {"id": np.array(self._ids)}
        if outcome is not None:
            info |= {name: np.array(getattr(outcome, name)) for name in _MEASURES}
            info |= {name: np.array(getattr(outcome.verdict, name)) for name in _VERDICT}
        return info | {f"_{name}": np.ones(self.num_envs, bool) for name in info}


def _error(position: np.ndarray, orientation: np.ndarray) -> np.ndarray:
    """What the dense reward calls the error [m]."""
    return position.astype(float) + _RADIAN * orientation.astype(float)


def _require_own_process() -> None:
    """JAX does not survive a fork: a forked environment would hang in its first step."""
    if os.getpid() != _PROCESS:
        raise RuntimeError(
            "drpbench environments cannot run in a forked process, for JAX cannot: expected "
            "gymnasium.make_vec(id, num_envs=N), which runs all of them in one compiled program, "
            "or vector_kwargs={'context': 'spawn'}"
        )
