"""What the environments show and take: the benchmark's observation and joint targets, as spaces."""

import numpy as np
from gymnasium.spaces import Box, Dict

from drpbench.contract import OBSERVED, ArraySpec, Observation, Spec, observation_spec
from drpbench.robot import PANDA, Robot


def action_space(robot: Robot = PANDA) -> Box:
    """Absolute joint position targets [rad], within the joint limits."""
    return Box(robot.joint_lower.astype(np.float32), robot.joint_upper.astype(np.float32))


def observation_space(spec: Spec | None = None) -> Dict:
    """The fields of an observation as the spec has them, by default the benchmark's."""
    return Dict({name: _box(of) for name, of in (spec or observation_spec()).items()})


def _box(of: ArraySpec) -> Box:
    lowest = 0 if of.dtype == np.bool_ else -of.bound
    return Box(lowest, of.bound, of.shape, of.dtype.type)


def as_dict(observation: Observation) -> dict[str, np.ndarray]:
    """An observation as arrays in host memory that are the caller's own, to keep or to write to."""
    return {name: np.array(getattr(observation, name)) for name in OBSERVED}
