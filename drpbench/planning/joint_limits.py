"""The joint range that planning keeps to: a little within the arm's own."""

import numpy as np
from jaxtyping import Float

from drpbench.robot import Robot

LIMIT_MARGIN = 0.05  # [rad] kept from the joint limits


def inner_limits(
    robot: Robot, dtype: type = np.float64
) -> tuple[Float[np.ndarray, " J"], Float[np.ndarray, " J"]]:
    """Lower and upper joint limits [rad], LIMIT_MARGIN within the arm's, computed in the given
    precision."""
    return (
        robot.joint_lower.astype(dtype) + LIMIT_MARGIN,
        robot.joint_upper.astype(dtype) - LIMIT_MARGIN,
    )
