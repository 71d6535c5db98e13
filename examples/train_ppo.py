"""Trains stable-baselines3's PPO on FDO, on two cores, and runs what it learned on the benchmark.

The network adds to the velocity of `straight`, which knows the goal and sees nothing, what it takes
to get round the boxes. It sees the arm, the goal, and for some points on the arm the nearest scene
point and the nearest one that moves. It decides every sixth control step, and only where something
moves near the arm. Nearness to it costs, beside the dense reward. Needs `pip install
'drpbench[sb3]'`.

python examples/train_ppo.py --steps 2_000_000 --out ppo.zip
drpbench run --task FDO --problems 64 --policy examples.train_ppo:Trained --policy-arg path=ppo.zip
"""

import argparse

import gymnasium
import numpy as np
from stable_baselines3 import PPO
from stable_baselines3.common.logger import configure
from stable_baselines3.common.vec_env import VecMonitor

import drpbench.gym  # noqa: F401 - registers the environments
from drpbench.compile import use_cache
from drpbench.gym.stable_baselines import StableBaselinesVecEnv
from drpbench.robot import PANDA

REPEAT = 6  # control steps a decision
EPISODE = -(-1000 // REPEAT)  # decisions; the last one is cut short
NEAR_COST = 0.1  # a decision, of what moves and touches; falls to none at REACH
REACH = 0.3  # [m] what is farther from the arm than this is not seen
EVERY = 16  # one of so many of the arm's 256 points looks around
SPEED = 0.5  # share of the velocity limits at which `straight` drives
MIDDLE, HALF = (
    np.float32((PANDA.joint_upper + sign * PANDA.joint_lower) / 2) for sign in (1.0, -1.0)
)
AHEAD = np.float32(PANDA.velocity_limit * PANDA.servo_lag)  # [rad] at the velocity limits


def straight(observation):
    """Shares of the velocity limits (B, 7) that lead straight to the goal joints."""
    needed = (observation["goal_joints"] - observation["joint_position"]) / AHEAD
    slowest = np.abs(needed).max(-1, keepdims=True)
    return needed * np.minimum(1.0, SPEED / np.maximum(slowest, 1e-9))


def look(arm, points, there, before):
    """For each of the arm's points (B, P, 3): the offset of the nearest scene point (B, P, 3), of
    the nearest one that moved since `before`, and that one's step [m], zeros where none is within
    REACH; and the distance of the nearest one that moved (B,)."""
    step = points - before
    moves = there & (np.abs(step).max(-1) > 1e-4)
    # |a - p|^2 without |a|^2, which makes no point nearer than another
    far = (points**2).sum(-1)[:, None] - 2.0 * arm @ points.swapaxes(1, 2)
    seen = []
    for which in (there, moves):
        nearest = np.where(which[:, None], far, np.inf).argmin(-1)[..., None]
        offset = np.take_along_axis(points, nearest, 1) - arm
        away = np.linalg.norm(offset, axis=-1)
        away[~np.take_along_axis(which, nearest[..., 0], 1)] = np.inf
        near = away < REACH
        seen.append(np.where(near[..., None], offset / REACH, 0.0))
    swift = np.take_along_axis(step, nearest, 1) * 10.0
    around = np.concatenate([*seen, np.where(near[..., None], swift, 0.0)], -1)
    return around, away.min(-1)


class Eyes:
    """What the network sees (B, F) of observations that follow one another; where something moves
    near the arm, `threatened` (B, 1); and how near it is, `danger` (B,)."""

    size = 3 * 7 + 256 // EVERY * 9

    def __init__(self, observation):
        self._before = observation["scene_points"]

    def see(self, observation):
        points, there = observation["scene_points"], observation["scene_mask"]
        arm = observation["robot_points"][:, ::EVERY]
        around, away = look(arm, points, there, self._before)
        self._before = points
        self.danger = np.maximum(1.0 - away / REACH, 0.0)
        self.threatened = self.danger[:, None] > 0.0
        joints = (observation["joint_position"] - MIDDLE) / HALF
        away = (observation["goal_joints"] - observation["joint_position"]) / HALF
        moving = observation["joint_velocity"] / np.float32(PANDA.velocity_limit)
        flat = around.reshape(len(around), -1)
        return np.concatenate([joints, away, moving, flat], -1).astype(np.float32)


class Decisions(gymnasium.vector.VectorWrapper):
    """Decisions, each of REPEAT control steps, that are added to `straight`."""

    def __init__(self, envs):
        super().__init__(envs)
        box = gymnasium.spaces.Box(-10.0, 10.0, (Eyes.size,), np.float32)
        self.single_observation_space = box
        self.observation_space = gymnasium.vector.utils.batch_space(box, envs.num_envs)

    def reset(self, *, seed=None, options=None):
        self._seen, info = self.env.reset(seed=seed, options=options)
        self._eyes = Eyes(self._seen)
        return self._eyes.see(self._seen), info

    def step(self, actions):
        total = np.zeros(self.num_envs)
        added = np.where(self._eyes.threatened, actions, 0.0)
        for _ in range(REPEAT):
            wanted = np.clip(straight(self._seen) + added, -1.0, 1.0)
            self._seen, reward, terminated, truncated, info = self.env.step(wanted)
            total += reward
            if truncated.any():
                break
        if truncated.any():  # the next episodes have begun
            ended = {name: np.stack([of[name] for of in info["final_obs"]]) for name in self._seen}
            info["final_obs"][:] = list(self._eyes.see(ended))
            self._eyes = Eyes(self._seen)
        seen = self._eyes.see(self._seen)
        return seen, total - NEAR_COST * self._eyes.danger**2, terminated, truncated, info


class Trained:
    """What was trained, as a host policy of the benchmark."""

    def __init__(self, path: str = "ppo.zip"):
        self._network = PPO.load(path, device="cpu")

    def reset(self, observation):
        """New episodes begin."""
        self._eyes, self._steps = Eyes(vars(observation)), 0

    def act(self, observation):
        """Absolute joint targets (B, 7) [rad]."""
        seen = vars(observation)
        if self._steps % REPEAT == 0:
            added, _ = self._network.predict(self._eyes.see(seen), deterministic=True)
            self._added = np.where(self._eyes.threatened, added, 0.0)
        self._steps += 1
        wanted = np.clip(straight(seen) + self._added, -1.0, 1.0)
        return observation.joint_position + wanted * AHEAD


def main():
    """Trains, and writes the network after every update."""
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--steps", type=int, default=2_000_000, help="decisions")
    options.add_argument("--lanes", type=int, default=64)
    options.add_argument("--problems", type=int, default=512, help="training problems to draw")
    options.add_argument("--out", default="ppo.zip")
    chosen = options.parse_args()

    use_cache()
    envs = gymnasium.make_vec(
        "drpbench/FDO-v1",
        num_envs=chosen.lanes,
        problems=range(chosen.problems),  # none of the benchmark's
        reward="dense",
        control_mode="delta",
        autoreset_mode="SameStep",
    )
    lanes = VecMonitor(StableBaselinesVecEnv(Decisions(envs)))
    network = PPO(
        "MlpPolicy",
        lanes,
        n_steps=EPISODE,
        batch_size=256,
        n_epochs=10,
        learning_rate=3e-4,
        gamma=0.99,
        policy_kwargs={"net_arch": [128, 128], "log_std_init": -0.3},
        device="cpu",
        seed=0,
    )
    network.set_logger(configure(None, ["stdout"]))
    while network.num_timesteps < chosen.steps:
        network.learn(EPISODE * chosen.lanes, reset_num_timesteps=False)
        network.save(chosen.out)


if __name__ == "__main__":
    main()
