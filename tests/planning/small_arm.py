"""An arm of four joints, made for the tests: a turning base and three joints that bend in its
plane."""

import json
from pathlib import Path

import numpy as np

from drpbench.robot import Link, Robot

_NAMES = ("link0", "link1", "link2", "link3", "link4", "hand")
# Centres and radii [m] in each link's own frame: rows along the link.
_ROWS = {
    "link0": [(0.0, 0.0, z, 0.06) for z in (0.06, 0.14)],
    "link1": [(0.0, 0.0, z, 0.05) for z in (-0.08, 0.0)],
    "link2": [(x, 0.0, 0.0, 0.045) for x in (0.06, 0.12, 0.18, 0.24)],
    "link3": [(x, 0.0, 0.0, 0.04) for x in (0.0, 0.06, 0.12, 0.18, 0.24)],
    "link4": [(x, 0.0, 0.0, 0.04) for x in (0.0, 0.05)],
    "hand": [(0.0, 0.0, z, 0.03) for z in (0.0, 0.05, 0.09)],
}
_MJCF = """
<mujoco>
  <compiler angle="radian"/>
  <worldbody>
    <body name="link0">
      <body name="link1" pos="0 0 0.3">
        <joint name="joint1" axis="0 0 1" range="-2.8 2.8"/><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>
        <body name="link2" quat="0.70710678 -0.70710678 0 0">
          <joint name="joint2" axis="0 0 1" range="-2 1"/><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>
          <body name="link3" pos="0.3 0 0">
            <joint name="joint3" axis="0 0 1" range="-2.5 2.5"/><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>
            <body name="link4" pos="0.3 0 0">
              <joint name="joint4" axis="0 0 1" range="-2 2"/><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>
              <body name="hand" pos="0.1 0 0" quat="0.5 0.5 0.5 0.5">
                <inertial pos="0 0 0" mass="0.1" diaginertia="0.1 0.1 0.1"/><site name="grip" pos="0 0 0.08"/>
              </body>
            </body>
          </body>
        </body>
      </body>
    </body>
  </worldbody>
</mujoco>
"""


def small_arm(folder: Path, blocks=(((0, 1), (4, 5)),)) -> Robot:
    """The arm, its files written into `folder`."""
    (folder / "arm.xml").write_text(_MJCF)
    (folder / "spheres.json").write_text(json.dumps(_ROWS))
    (folder / "surface.json").write_text(
        json.dumps({name: [row[:3] for row in rows] for name, rows in _ROWS.items()})
    )
    return Robot(
        name="small",
        folder=folder,
        links=tuple(Link(name, frame) for frame, name in enumerate(_NAMES)),
        joint_offset=np.array([(0, 0, 0.3), (0, 0, 0), (0.3, 0, 0), (0.3, 0, 0)], float),
        joint_twist=np.array([0.0, -0.5 * np.pi, 0.0, 0.0]),
        hand_offset=np.array([0.1, 0.0, 0.0]),
        hand_rotation=np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]),
        grip_offset=0.08,
        joint_lower=np.array([-2.8, -2.0, -2.5, -2.0]),
        joint_upper=np.array([2.8, 1.0, 2.5, 2.0]),
        velocity_limit=np.full(4, 2.0),
        acceleration_limit=np.full(4, 10.0),
        jerk_limit=np.full(4, 5000.0),
        torque_limit=np.full(4, 50.0),
        home=np.array([0.0, -0.8, 1.2, 0.6]),
        home_spread=np.array([0.5, 0.5, 0.5, 0.0]),
        generation_spread=np.array([0.5, 0.5, 0.5, 0.0]),
        lever=np.array([0.83, 0.83, 0.53, 0.23]),
        servo_lag=0.05,
        self_collision_blocks=blocks,
        forearm=3,
    )
