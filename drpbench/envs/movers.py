"""The drawing of boxes that appear, move and vanish during an episode."""

from collections.abc import Callable
from dataclasses import replace

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, PRNGKeyArray

from drpbench.contract import Movers
from drpbench.geometry import BOX, FAR, Primitives, quaternion_to_matrix, signed_distance
from drpbench.robot import Robot

from .arm import Arm
from .random import quickly_compiled


def random_rotation(key: PRNGKeyArray) -> Float[Array, "3 3"]:
    """Uniform over all rotations."""
    quaternion = jax.random.normal(key, (4,))
    return quaternion_to_matrix(quaternion / jnp.linalg.norm(quaternion))


def clearance_of_box(
    half_size: Float[Array, "3"],
    rotation: Float[Array, "3 3"],
    position: Float[Array, "3"],
    centers: Float[Array, "S 3"],
    radii: Float[Array, " S"],
) -> Float[Array, ""]:
    """Smallest distance [m] between one box and spheres; negative when they overlap."""
    box = Primitives(
        kind=jnp.full(1, BOX, jnp.int32),
        half_size=half_size[None],
        position=position[None],
        rotation=rotation[None],
        mask=jnp.ones(1, bool),
    )
    return jnp.min(signed_distance(centers, box) - radii)


def in_upper_shell(
    key: PRNGKeyArray, center: Float[Array, "3"], inner: float, outer: float
) -> Float[Array, "3"]:
    """Uniform in direction over the upper half of a spherical shell, and in radius [m]."""
    direction_key, radius_key = jax.random.split(key)
    direction = jax.random.normal(direction_key, (3,))
    direction = direction / jnp.linalg.norm(direction)
    direction = direction.at[2].set(jnp.abs(direction[2]))
    return center + direction * jax.random.uniform(radius_key, minval=inner, maxval=outer)


def random_heading(
    key: PRNGKeyArray, toward: Float[Array, "3"], deviation: float, pace: float = 1.0
) -> Float[Array, "3"]:
    """A velocity [m a control step] of 0.06 to 0.18 m/s roughly along `toward`: 1 to 3 mm at 60 Hz.

    N(0, deviation) is added to each component of the unit direction. `pace` is the episode's.
    """
    heading_key, speed_key = jax.random.split(key)
    heading = toward / jnp.linalg.norm(toward) + deviation * jax.random.normal(heading_key, (3,))
    speed = jax.random.uniform(speed_key, minval=0.001 * pace, maxval=0.003 * pace)
    return speed * heading / jnp.linalg.norm(heading)


def first_clear(
    draw: Callable[[PRNGKeyArray], Float[Array, "3"]],
    allowed: Callable[[Float[Array, "3"]], Bool[Array, ""]],
    key: PRNGKeyArray,
    room: float,
    half_size: Float[Array, "3"],
    rotation: Float[Array, "3 3"],
    centers: Float[Array, "S 3"],
    radii: Float[Array, " S"],
) -> Float[Array, "3"]:
    """The first of 32 drawn positions that is allowed and has more than `room` [m] to the arm.

    Where there is none, the one with most room.
    """
    places = jax.vmap(draw)(jax.random.split(key, 32))

    def rate(place: Float[Array, "3"]) -> Float[Array, ""]:
        clearance = clearance_of_box(half_size, rotation, place, centers, radii)
        return jnp.where(allowed(place), clearance, -jnp.inf)

    clearance = jax.vmap(rate)(places)
    clear = clearance > room
    return places[jnp.where(clear.any(), jnp.argmax(clear), jnp.argmax(clearance))]


def drifting_box(
    key: PRNGKeyArray,
    longest: Float[Array, ""] | float,
    place: Callable[[PRNGKeyArray], Float[Array, "3"]],
    excess: Callable[[Float[Array, "3"]], Float[Array, ""]],
    target: Float[Array, "3"],
    deviation: float,
    arm: Arm,
    pace: float,
) -> Movers:
    """One box with edges of 0.1 m to `longest` [m], 1 cm clear of the arm, on its way to `target`.

    `place` draws where it is born; `excess` of a position says how far [m] that is outside of where
    it may be; `deviation` and `pace` are `random_heading`'s.
    """
    keys = jax.random.split(quickly_compiled(key), 4)
    half_size = jax.random.uniform(keys[0], (3,), minval=0.05, maxval=longest / 2)
    rotation = random_rotation(keys[1])
    position = first_clear(
        place,
        lambda p: excess(p) <= 0.0,
        keys[2],
        0.01,
        half_size,
        rotation,
        arm.centers,
        arm.radii,
    )
    velocity = random_heading(keys[3], target - position, deviation, pace)
    return Movers(half_size, rotation, position, velocity, jnp.bool_(True))


def depth_in_core(
    half_size: Float[Array, "3"],
    rotation: Float[Array, "3 3"],
    position: Float[Array, "3"],
    robot: Robot,
) -> Float[Array, ""]:
    """How deep [m] a box is in the arm's `immovable_core`, negative outside: a box in there is a
    collision that no policy can avoid."""
    centers, radii = robot.immovable_core
    if not len(radii):
        return jnp.float32(-FAR)
    return -clearance_of_box(
        half_size, rotation, position, jnp.asarray(centers), jnp.asarray(radii)
    )


def drift(
    movers: Movers, excess: Callable[[Float[Array, "M 3"]], Float[Array, " M"]], robot: Robot
) -> Movers:
    """One control step of straight motion. `excess` [m] is how far a box's centre is where it may
    not be.

    A box turns back instead of going deeper; before the arm's immovable core too.
    """

    def beyond(position: Float[Array, "M 3"]) -> Float[Array, " M"]:
        depth = jax.vmap(lambda h, r, p: depth_in_core(h, r, p, robot))
        return jnp.maximum(excess(position), depth(movers.half_size, movers.rotation, position))

    ahead = movers.position + movers.velocity
    turns = (beyond(ahead) > 0.0) & (beyond(ahead) > beyond(movers.position))
    turns = turns[:, None]
    return replace(
        movers,
        position=jnp.where(turns, movers.position, ahead),
        velocity=jnp.where(turns, -movers.velocity, movers.velocity),
    )
