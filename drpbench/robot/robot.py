"""An arm as a value: its joints, limits, frames, collision spheres and surface.

A serial chain of revolute joints with a rigid hand at its end. Everything that depends on the arm
takes a `Robot`; it is hashable, so it is a static argument under `jax.jit`.
"""

from collections.abc import Callable
from dataclasses import dataclass, fields
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from drpbench.compile import short_loops_unrolled, stored

from .body_points import BodyPoints, Link, read_points
from .link_poses import LinkPoses, point_jacobian
from .solids import Solid, balls

method_compiled_once = partial(jax.jit, static_argnums=0, inline=True)
"""For methods of a `Robot`: a loop outside jit compiles them once, and inside jit they leave no
trace."""


@dataclass(frozen=True)
class RealMeshes:
    """The arm's real collision meshes, as a witness on the host. They are not part of drpbench."""

    find: Callable[[], Path | None]
    """The MJCF with the meshes, or None where there is none on this machine."""
    spec: Callable[..., Any]
    """From that path, the arm with its meshes as a `mujoco.MjSpec`."""
    absent: str
    """What to say where there is none."""


@dataclass(frozen=True, eq=False)
class Robot:
    """An arm of J revolute joints. SI units; arrays are one number a joint.

    Frames: 0 the base, 1 to J each behind its joint, J + 1 the hand. Joint i's frame is its
    parent's, moved by `joint_offset` [m], turned by `joint_twist` [rad] about x, and turned by the
    joint about z (modified Denavit and Hartenberg's parameters, Craig 1986, with the offset in the
    parent's axes).
    """

    name: str
    folder: Path
    """Holds `arm.xml` (MJCF without meshes), `spheres.json` and `surface.json`."""
    links: tuple[Link, ...]
    """Bodies that can touch, sorted by frame; the first is the base."""
    joint_offset: np.ndarray  # (J, 3) [m]
    joint_twist: np.ndarray  # (J,) [rad]
    hand_offset: np.ndarray  # (3,) [m] of the hand in the last joint's frame
    hand_rotation: np.ndarray  # (3, 3) the hand's axes in the last joint's frame
    grip_offset: float
    """[m] from the hand along its z to the frame `grip`, the end effector."""
    joint_lower: np.ndarray  # (J,) [rad]
    joint_upper: np.ndarray  # (J,) [rad]
    velocity_limit: np.ndarray  # (J,) [rad/s]
    acceleration_limit: np.ndarray  # (J,) [rad/s^2]
    jerk_limit: np.ndarray  # (J,) [rad/s^3]
    torque_limit: np.ndarray  # (J,) [N m]
    home: np.ndarray  # (J,) [rad]
    home_spread: np.ndarray  # (J,) [rad]
    """How far about `home` postures are drawn, as seeds of inverse kinematics."""
    generation_spread: np.ndarray  # (J,) [rad]
    """The same for the host's, which draws numbered problems: another value makes other problems.
    """
    lever: np.ndarray  # (J,) [m]
    """Largest distance of any point that a joint moves from its axis: turning by d moves none
    farther than lever * |d|."""
    servo_lag: float
    """[s] kd / kp of the servos: a target this far ahead makes the arm move at the speed meant."""
    self_collision_blocks: tuple[tuple[tuple[int, ...], tuple[int, ...]], ...]
    """Frames that can touch: every one of a first group against every one of its second. The first
    block is the one that planners keep room in."""
    forearm: int
    """The first frame beyond the elbow: from there on the arm feels its way."""
    meshes: RealMeshes | None = None
    figure: Callable[[], tuple[Solid, ...]] | None = None
    """The arm as solids, to be drawn; without it its collision spheres are."""

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if isinstance(value, np.ndarray):
                value.setflags(write=False)

    @cached_property
    def _key(self) -> tuple:
        # How it is drawn and judged on the host changes nothing that is computed; and functions,
        # once pickled, are not what they were.
        names = (field.name for field in fields(self) if field.name not in ("meshes", "figure"))
        values = (getattr(self, name) for name in names)
        return tuple(v.tobytes() if isinstance(v, np.ndarray) else v for v in values)

    def __hash__(self) -> int:
        return hash(self._key)

    def __eq__(self, other: object) -> bool:
        return self is other or (isinstance(other, Robot) and self._key == other._key)

    def __repr__(self) -> str:
        return f"Robot({self.name!r}, joints={self.joints})"

    @property
    def joints(self) -> int:
        """J"""
        return len(self.home)

    @property
    def hand(self) -> int:
        """The hand's frame, J + 1."""
        return self.joints + 1

    @property
    def model(self) -> Path:
        """The MJCF without meshes."""
        return self.folder / "arm.xml"

    def spec(self) -> Any:
        """The arm without meshes as a `mujoco.MjSpec`, its fingers as open as its links say."""
        import mujoco

        spec = mujoco.MjSpec.from_file(str(self.model))
        for link in self.links:
            if any(link.offset):
                spec.body(link.name).pos = link.offset
        return spec

    @cached_property
    def link_names(self) -> tuple[str, ...]:
        return tuple(link.name for link in self.links)

    @cached_property
    def frame_names(self) -> tuple[str, ...]:
        """Of each frame the link that it is named after: the first of those rigid in it."""
        names = {link.frame: link.name for link in reversed(self.links)}
        return tuple(names[frame] for frame in range(self.hand + 1))

    @cached_property
    def solids(self) -> tuple[Solid, ...]:
        """What is drawn of the arm where its meshes are not at hand."""
        return self.figure() if self.figure else balls(self.spheres)

    @cached_property
    def spheres(self) -> BodyPoints:
        """All collision spheres of the arm, the base's included."""
        return read_points(self.folder / "spheres.json", self.links)

    @cached_property
    def moving_spheres(self) -> BodyPoints:
        """The spheres that a policy answers for: all but the immovable base's."""
        return self.spheres.part(self.spheres.frame > 0)

    @cached_property
    def immovable_core(self) -> tuple[np.ndarray, np.ndarray]:
        """Where the first moving link is at every angle of its joint, as spheres about the joint's
        axis: centres (K, 3) in the world frame and radii (K,), both [m].

        A sphere of radius r at distance d from the axis always covers the ball of radius r - d
        about its foot on the axis. No policy can move the arm out of there.
        """
        link = self.spheres.part(self.spheres.frame == 1)
        radius = link.radius - np.hypot(link.local[:, 0], link.local[:, 1])
        covers = radius > 0.0
        twist = self.joint_twist[0]
        axis = np.array([0.0, -np.sin(twist), np.cos(twist)])
        centers = self.joint_offset[0] + link.local[covers, 2:] * axis
        return centers.astype(np.float32), radius[covers].astype(np.float32)

    @cached_property
    def surface(self) -> BodyPoints:
        """Points on the outer surface of the moving links."""
        return read_points(self.folder / "surface.json", self.links)

    def surface_points(self, count: int) -> BodyPoints:
        """`count` points of the surface, evenly chosen."""
        points = self.surface
        return points.part(np.linspace(0, points.count - 1, count).round().astype(int))

    @method_compiled_once
    def link_poses(self, q: Float[Array, " J"]) -> LinkPoses:
        """World poses of the frames at joint positions `q` [rad].

        All by components: nothing for TF32 to round.
        """

        def joint(frame, fixed):
            origin, x, y, z = frame
            offset, twist, cos, sin = fixed
            origin = origin + offset[0] * x + offset[1] * y + offset[2] * z
            y, z = _twisted(y, z, twist)
            x, y = cos * x + sin * y, cos * y - sin * x
            frame = (origin, x, y, z)
            return frame, frame

        base = (jnp.zeros(3, q.dtype), *jnp.eye(3, dtype=q.dtype))  # origin, and the axes x, y, z
        fixed = (jnp.asarray(self.joint_offset, q.dtype), _twists(self.joint_twist, q.dtype))
        chain = (*fixed, jnp.cos(q), jnp.sin(q))
        (origin, x, y, z), moving = jax.lax.scan(joint, base, chain, unroll=short_loops_unrolled())
        hand = (
            _combined(origin, self.hand_offset, (x, y, z)),
            *(_turned(column, (x, y, z)) for column in self.hand_rotation.T),
        )
        position, x, y, z = (
            jnp.concatenate([first[None], middle, last[None]])
            for first, middle, last in zip(base, moving, hand, strict=True)
        )
        return LinkPoses(position=position, rotation=jnp.stack([x, y, z], axis=-1))

    @method_compiled_once
    def grip_pose(self, poses: LinkPoses) -> tuple[Float[Array, "3"], Float[Array, "3 3"]]:
        """Position [m] and rotation of the end-effector frame `grip`."""
        rotation = poses.rotation[-1]
        return poses.position[-1] + self.grip_offset * rotation[:, 2], rotation

    @method_compiled_once
    def grip_jacobian(self, poses: LinkPoses) -> Float[Array, "6 J"]:
        """Geometric Jacobian of the frame `grip`: linear [m/rad] above angular rows."""
        position, _ = self.grip_pose(poses)
        return jnp.concatenate([point_jacobian(poses, position, self.hand), poses.axes.T])

    @method_compiled_once
    def self_clearance(self, poses: LinkPoses) -> Float[Array, ""]:
        """Smallest distance [m] between spheres of two links that can touch; negative in
        self-collision."""
        model = self.spheres
        points = model.world(poses)
        clearance = jnp.float32(1.0e6)
        for first, second in self.self_collision_blocks:
            a, b = np.isin(model.frame, first), np.isin(model.frame, second)
            others, p, r = points[a], points[b], model.radius[b]

            def visit(nearest, sphere, p=p, r=r):
                x, y, z, radius = sphere
                dx, dy, dz = p[:, 0] - x, p[:, 1] - y, p[:, 2] - z
                gap = jnp.sqrt(dx * dx + dy * dy + dz * dz) - (r + radius)
                # jnp.minimum looks for NaN in both, at twice the cost.
                return jnp.where(gap > nearest, nearest, gap), None

            rows = (others[:, 0], others[:, 1], others[:, 2], jnp.asarray(model.radius[a]))
            nearest, _ = jax.lax.scan(visit, jnp.full(len(r), 1.0e6), rows, unroll=True)
            clearance = jnp.minimum(clearance, jnp.min(stored(nearest)))
        return clearance


def _twists(angles: np.ndarray, dtype: Any) -> tuple[Array, ...]:
    """What `_twisted` needs of each joint: quarter turns as -1, 0 or 1; other angles as cosine and
    sine."""
    quarters = np.round(angles / (0.5 * np.pi))
    if np.allclose(angles, quarters * 0.5 * np.pi, atol=1e-9) and np.abs(quarters).max() <= 1:
        return (jnp.asarray(quarters, dtype),)
    return (jnp.asarray(np.cos(angles), dtype), jnp.asarray(np.sin(angles), dtype))


def _twisted(y: Array, z: Array, twist: tuple[Array, ...]) -> tuple[Array, Array]:
    """The axes y and z turned about x. Quarter turns take no sum, so nothing of them can be
    rounded."""
    if len(twist) == 1:
        (turn,) = twist
        return jnp.where(turn == 0, y, turn * z), jnp.where(turn == 0, z, -turn * y)
    cos, sin = twist
    return cos * y + sin * z, cos * z - sin * y


def _combined(origin: Array, coefficients: np.ndarray, axes: tuple[Array, ...]) -> Array:
    """origin + sum of coefficients times axes, without the terms that are zero."""
    for coefficient, axis in zip(coefficients.tolist(), axes, strict=True):
        if coefficient:
            origin = origin + coefficient * axis
    return origin


def _turned(column: np.ndarray, axes: tuple[Array, ...]) -> Array:
    """sum of column times axes: its largest entry times a sum of ratios, so that turns by multiples
    of 45 degrees are rounded once."""
    largest = float(np.abs(column).max())
    ratios = [entry / largest for entry in column.tolist()]
    # The first term that counts begins the sum; turns by 45 degrees have ratios of 1 and -1.
    terms = [(ratio, axis) for ratio, axis in zip(ratios, axes, strict=True) if ratio]
    (ratio, axis), *others = terms
    total = axis if ratio == 1.0 else ratio * axis
    for ratio, axis in others:
        if abs(ratio) == 1.0:
            total = total + axis if ratio > 0.0 else total - axis
        else:
            total = total + ratio * axis
    return total if largest == 1.0 else largest * total
