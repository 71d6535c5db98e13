"""A spatial arm of four joints, written to a folder: what must work for any number of joints."""

import json

import numpy as np

from drpbench.robot import Link, Robot

UPPER, FOREARM, HAND = 0.4, 0.3, 0.1  # [m] along z of each frame
BASE_HEIGHT = 0.3  # [m]
_QUARTER = 0.5 * np.pi
_TORQUE = 80.0  # [N m]

# Joint 1 turns about the vertical, 2 to 4 about the horizontal axes y of the frames before them; at
# zero the arm points straight up. Frames by the convention of `Robot`: moved, turned by
# `joint_twist` about x, turned about z.
_OFFSET = np.array([(0, 0, BASE_HEIGHT), (0, 0, 0), (0, -UPPER, 0), (0, -FOREARM, 0)], float)
_TWIST = np.array([0.0, -_QUARTER, 0.0, 0.0])

_BODY = """
<body name="link{i}" pos="{pos}" euler="{twist} 0 0">
  <joint name="joint{i}" range="{low} {high}"/>
  <inertial pos="{com}" mass="1" diaginertia="0.01 0.01 0.01"/>
  {inner}
</body>"""


def _column(along, length, count, radius):
    """Spheres (x, y, z, radius) in a row from a frame's origin."""
    return [[*(np.array(along) * s).tolist(), radius] for s in np.linspace(0.0, length, count)]


def toy_arm(folder):
    """Writes `arm.xml`, `spheres.json` and `surface.json` into a folder; returns the Robot."""
    lower, upper = np.array([-2.8, -2.0, -2.4, -2.0]), np.array([2.8, 2.0, 2.4, 2.0])
    up = (0.0, -1.0, 0.0)  # along the link, in the frames of joints 2 to 4
    inner = (
        f'<body name="hand" pos="0 {-HAND} 0" euler="{_QUARTER} 0 0">'
        '<inertial pos="0 0 0" mass="0.3" diaginertia="0.001 0.001 0.001"/></body>'
    )
    centers = [(0, 0, 0), (0, -UPPER / 2, 0), (0, -FOREARM / 2, 0), (0, -HAND / 2, 0)]
    for i in range(4, 0, -1):
        inner = _BODY.format(
            i=i,
            pos=" ".join(map(str, _OFFSET[i - 1])),
            twist=_TWIST[i - 1],
            low=lower[i - 1],
            high=upper[i - 1],
            com=" ".join(map(str, centers[i - 1])),
            inner=inner,
        )
    servos = "".join(
        f'<position name="servo{i}" joint="joint{i}" forcerange="{-_TORQUE} {_TORQUE}"/>'
        for i in range(1, 5)
    )
    (folder / "arm.xml").write_text(
        f"""<mujoco model="toy">
  <compiler angle="radian" autolimits="true"/>
  <option timestep="0.008333333333333333" integrator="implicitfast" gravity="0 0 0">
    <flag contact="disable" constraint="disable"/>
  </option>
  <default><joint axis="0 0 1" armature="0.1" damping="1"/><position kp="1000" kv="50"/></default>
  <worldbody><body name="link0">
    <inertial pos="0 0 0" mass="1" diaginertia="0.01 0.01 0.01"/>{inner}
  </body></worldbody>
  <actuator>{servos}</actuator>
</mujoco>"""
    )
    spheres = {
        "link0": _column((0, 0, 1), 0.2, 3, 0.06),
        "link1": [[0.0, 0.0, 0.0, 0.06]],
        "link2": _column(up, UPPER - 0.05, 5, 0.05),
        "link3": _column(up, FOREARM - 0.05, 4, 0.045),
        "link4": _column(up, HAND, 2, 0.04),
        "hand": [[0.0, 0.0, 0.05, 0.035]],
    }
    (folder / "spheres.json").write_text(json.dumps(spheres))
    rng = np.random.default_rng(0)
    surface = {}
    for name, rows in spheres.items():
        if name != "link0":
            outward = rng.normal(size=(len(rows), 30, 3))
            outward /= np.linalg.norm(outward, axis=-1, keepdims=True)
            centers, radii = np.array(rows)[:, None, :3], np.array(rows)[:, None, 3:]
            surface[name] = (centers + radii * outward).reshape(-1, 3).tolist()
    (folder / "surface.json").write_text(json.dumps(surface))
    return Robot(
        name="toy",
        folder=folder,
        links=(*(Link(f"link{frame}", frame) for frame in range(5)), Link("hand", 5)),
        joint_offset=_OFFSET,
        joint_twist=_TWIST,
        hand_offset=np.array([0.0, -HAND, 0.0]),
        hand_rotation=np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]),
        grip_offset=0.05,
        joint_lower=lower,
        joint_upper=upper,
        velocity_limit=np.full(4, 2.0),
        acceleration_limit=np.full(4, 10.0),
        jerk_limit=np.full(4, 5000.0),
        torque_limit=np.full(4, _TORQUE),
        home=np.array([0.0, 0.5, 0.8, 0.5]),
        home_spread=np.full(4, 0.5),
        generation_spread=np.full(4, 0.5),
        lever=np.array([0.9, 0.9, 0.5, 0.2]),
        servo_lag=0.05,
        self_collision_blocks=(((0, 1), (3, 4, 5)),),
        forearm=3,
    )
