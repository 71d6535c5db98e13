"""IMPACT, the paper's network: point clouds and joint configurations in, a chunk of joint motion
out.

    tokens = [set abstraction of the scene + e_s, of the robot + e_r,
              MLP(q_c) + e_c, MLP(q_mg) + e_mg, ...]
    chunk  = linear(decoder(A, encoder(tokens)))        A: ten learnable action tokens

After the paper's "IMPACT" section and its table of hyperparameters. Where the paper leaves a
choice:

- A third state token holds goal minus current joints, as in the authors' code; the paper has two.
  It also holds the direction of that difference, because the chunk's units shrink at the goal
  (`chunks.py`), and what must be told there is a direction.
- Type embeddings are added, as in the paper (the authors' code concatenates them).
- The sin/cos positional encoding of the paper's table is that of the coordinates of a point token's
  centre: a set of tokens has no other order. The set abstraction itself sees relative coordinates
  only.
- Norms stand before each sublayer, with one after each stack: such networks train without a long
  warm-up. Activations are ReLU, as in the authors' code.
"""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from flax import nnx
from jax.typing import DTypeLike
from jaxtyping import Array, Bool, Float

from drpbench.robot import PANDA, Robot

from . import as_functions
from .arm import arm_at, joint_inputs, world
from .as_functions import Parameters as Parameters
from .chunks import CHUNK
from .feelers import feeler_points, most_feelers
from .impact_size import FULL as FULL
from .impact_size import SIZES as SIZES
from .impact_size import SMALL as SMALL
from .impact_size import ImpactSize
from .layers import Linear, attention, greatest
from .set_abstraction import farthest_points, gather, in_pieces, neighbourhoods

_LONGEST, _SHORTEST = 4.0, 0.1  # [m] wavelengths of the positional encoding
_CLOSE = 0.1  # [m]


def positional_encoding(
    positions: Float[Array, "*batch 3"], width: int
) -> Float[Array, "*batch {width}"]:
    """Sines and cosines of each coordinate [m], wavelengths from 4 m to 0.1 m; the rest is zero."""
    count = width // 6
    frequency = 2.0 * np.pi / np.geomspace(_LONGEST, _SHORTEST, count)
    phase = positions[..., None] * jnp.asarray(frequency, positions.dtype)
    waves = jnp.concatenate([jnp.sin(phase), jnp.cos(phase)], axis=-1)
    waves = waves.reshape(*positions.shape[:-1], 6 * count)
    return jnp.pad(waves, [(0, 0)] * (waves.ndim - 1) + [(0, width - 6 * count)])


def _closeness(
    points: Float[Array, "*batch N 3"], arm: Float[Array, "*batch R 3"]
) -> Float[Array, "*batch N"]:
    """exp(-d / _CLOSE), d the distance [m] of each point to the nearest of the arm's."""

    def visit(nearest: Array, one: Array) -> tuple[Array, None]:
        away = sum(jnp.square(points[..., i] - one[..., i, None]) for i in range(3))
        return jnp.minimum(nearest, away), None

    far = jnp.full(points.shape[:-1], jnp.inf, points.dtype)
    squared, _ = jax.lax.scan(visit, far, jnp.moveaxis(arm, -2, 0))
    return jnp.exp(-jnp.sqrt(squared) / _CLOSE)


class PointTokens(nnx.Module):
    """Set abstraction and its projection to tokens."""

    def __init__(
        self,
        size: ImpactSize,
        tokens: int,
        radius: float,
        samples: int,
        dtype: DTypeLike,
        rngs: nnx.Rngs,
        features: int = 0,
    ):
        self.tokens, self.radius, self.samples = tokens, radius, samples
        widths = (3 + features, *size.point_mlp)
        self.point_mlp = nnx.List(
            Linear(a, b, dtype=dtype, rngs=rngs) for a, b in zip(widths, widths[1:], strict=False)
        )
        self.hidden = Linear(widths[-1], 2 * size.width, dtype=dtype, rngs=rngs)
        self.norm = nnx.LayerNorm(2 * size.width, dtype=dtype, rngs=rngs)
        self.out = Linear(2 * size.width, size.width, dtype=dtype, rngs=rngs)
        self.dtype = dtype

    def __call__(
        self,
        points: Float[Array, "*batch N 3"],
        mask: Bool[Array, "*batch N"],
        *features: Float[Array, "*batch N F"],
        centers: Float[Array, "*batch T 3"] | None = None,
    ) -> Float[Array, "*batch T H"]:
        """A token for each of `centers`; without them, for points of the cloud that are far
        apart."""
        batch = mask.shape[:-1]
        points, mask, *felt = (
            leaf.reshape(-1, *leaf.shape[len(batch) :]) for leaf in (points, mask, *features)
        )
        if centers is None:
            centers = gather(points, farthest_points(points, mask, self.tokens))
        else:
            centers = centers.reshape(-1, *centers.shape[len(batch) :])
        clouds = (points, mask, centers, *felt)
        pooled = in_pieces(self._pooled, self.tokens * self.samples, *clouds)
        tokens = self.out(nnx.relu(self.norm(self.hidden(pooled))))
        tokens = tokens + positional_encoding(centers, tokens.shape[-1]).astype(tokens.dtype)
        # A cloud without points is told by tokens of zeros.
        tokens = jnp.where(mask.any(axis=-1)[..., None, None], tokens, 0.0)
        return tokens.reshape(*batch, *tokens.shape[1:])

    def _pooled(
        self,
        points: Float[Array, "*batch N 3"],
        mask: Bool[Array, "*batch N"],
        centers: Float[Array, "*batch T 3"],
        features: Float[Array, "*batch N F"] | None = None,
    ) -> Float[Array, "*batch T C"]:
        """The shared MLP and its maximum over each neighbourhood."""
        x = neighbourhoods(points, mask, centers, self.radius, self.samples, features)
        # Around a centre that is no point of the cloud there may be none.
        there = jnp.sum(jnp.square(x[..., 0, :3]), axis=-1, keepdims=True) < 1.0
        x = x.astype(self.dtype)
        for layer in self.point_mlp[:-1]:
            x = nnx.relu(layer(x))
        # ReLU keeps order, so it may follow the maximum.
        return jnp.where(there, nnx.relu(greatest(self.point_mlp[-1](x))), 0.0)


class Attention(nnx.Module):
    """Multi-head attention of one sequence to another, or to itself."""

    def __init__(self, size: ImpactSize, dtype: DTypeLike, rngs: nnx.Rngs):
        self.heads = size.heads
        self.query = Linear(size.width, size.width, dtype=dtype, rngs=rngs)
        self.key_value = Linear(size.width, 2 * size.width, dtype=dtype, rngs=rngs)
        self.out = Linear(size.width, size.width, dtype=dtype, rngs=rngs)

    def __call__(
        self, x: Float[Array, "*batch Q H"], memory: Float[Array, "*batch T H"]
    ) -> Float[Array, "*batch Q H"]:
        q = self._split(self.query(x))
        k, v = map(self._split, jnp.split(self.key_value(memory), 2, axis=-1))
        y = jnp.swapaxes(attention(q, k, v), -2, -3)
        return self.out(y.reshape(x.shape))

    def _split(self, x: Float[Array, "*batch T H"]) -> Float[Array, "*batch h T D"]:
        """(..., T, H) to (..., heads, T, H / heads)."""
        return jnp.swapaxes(x.reshape(*x.shape[:-1], self.heads, -1), -2, -3)


class FeedForward(nnx.Module):
    """Two linear layers about a ReLU."""

    def __init__(self, size: ImpactSize, dtype: DTypeLike, rngs: nnx.Rngs):
        self.hidden = Linear(size.width, size.feed_forward, dtype=dtype, rngs=rngs)
        self.out = Linear(size.feed_forward, size.width, dtype=dtype, rngs=rngs)

    def __call__(self, x: Float[Array, "*batch T H"]) -> Float[Array, "*batch T H"]:
        return self.out(nnx.relu(self.hidden(x)))


class EncoderLayer(nnx.Module):
    """x += attention(norm x); x += feed forward(norm x)."""

    def __init__(self, size: ImpactSize, dtype: DTypeLike, rngs: nnx.Rngs):
        self.attention = Attention(size, dtype, rngs)
        self.feed_forward = FeedForward(size, dtype, rngs)
        self.norm_1 = nnx.LayerNorm(size.width, dtype=dtype, rngs=rngs)
        self.norm_2 = nnx.LayerNorm(size.width, dtype=dtype, rngs=rngs)

    def __call__(self, x: Float[Array, "*batch T H"]) -> Float[Array, "*batch T H"]:
        y = self.norm_1(x)
        x = x + self.attention(y, y)
        return x + self.feed_forward(self.norm_2(x))


class DecoderLayer(nnx.Module):
    """As the encoder's, with attention to the encoder's tokens in the middle."""

    def __init__(self, size: ImpactSize, dtype: DTypeLike, rngs: nnx.Rngs):
        self.attention = Attention(size, dtype, rngs)
        self.cross = Attention(size, dtype, rngs)
        self.feed_forward = FeedForward(size, dtype, rngs)
        self.norm_1 = nnx.LayerNorm(size.width, dtype=dtype, rngs=rngs)
        self.norm_2 = nnx.LayerNorm(size.width, dtype=dtype, rngs=rngs)
        self.norm_3 = nnx.LayerNorm(size.width, dtype=dtype, rngs=rngs)

    def __call__(
        self, x: Float[Array, "*batch 10 H"], memory: Float[Array, "*batch T H"]
    ) -> Float[Array, "*batch 10 H"]:
        y = self.norm_1(x)
        x = x + self.attention(y, y)
        x = x + self.cross(self.norm_2(x), memory)
        return x + self.feed_forward(self.norm_3(x))


class JointToken(nnx.Module):
    """An MLP from a configuration to one token."""

    def __init__(self, inputs: int, size: ImpactSize, dtype: DTypeLike, rngs: nnx.Rngs):
        widths = (inputs, *size.joint_mlp, size.width)
        self.layers = nnx.List(
            Linear(a, b, dtype=dtype, rngs=rngs) for a, b in zip(widths, widths[1:], strict=False)
        )

    def __call__(self, x: Float[Array, "*batch D"]) -> Float[Array, "*batch H"]:
        for layer in self.layers[:-1]:
            x = nnx.relu(layer(x))
        return self.layers[-1](x)


class ImpactNetwork(nnx.Module):
    """The network as a Flax module; `apply` is the same as a pure function of its parameters.

    Computes in `dtype`; parameters, joints and positions are float32.
    """

    def __init__(
        self,
        size: ImpactSize,
        rngs: nnx.Rngs,
        dtype: DTypeLike = jnp.float32,
        robot: Robot = PANDA,
    ):
        """Raises ValueError for more feelers than the arm has places for."""
        if size.feelers > most_feelers(robot):
            raise ValueError(
                f"feelers must be 0 to {most_feelers(robot)} on {robot.name}, got {size.feelers}"
            )
        self.size, self.arm = size, robot
        near = size.radius, size.samples
        features = 2 if size.sees_goal else 0
        self.scene = PointTokens(size, size.scene_tokens, *near, dtype, rngs, features)
        self.robot = PointTokens(size, size.robot_tokens, *near, dtype, rngs)
        self.current = JointToken(robot.joints, size, dtype, rngs)
        self.goal = JointToken(robot.joints, size, dtype, rngs)
        self.difference = JointToken(2 * robot.joints, size, dtype, rngs)
        draw = nnx.initializers.normal(0.02)
        self.types = nnx.Param(draw(rngs.params(), (6 if size.sees_goal else 5, size.width)))
        if size.feelers:
            near = size.feeler_radius, size.feeler_samples
            self.feeler = PointTokens(size, size.feelers, *near, dtype, rngs)
            self.places = nnx.Param(draw(rngs.params(), (2, size.feelers, size.width)))
        self.actions = nnx.Param(draw(rngs.params(), (CHUNK, size.width)))
        self.encoder = nnx.List(EncoderLayer(size, dtype, rngs) for _ in range(size.encoder_layers))
        self.decoder = nnx.List(DecoderLayer(size, dtype, rngs) for _ in range(size.decoder_layers))
        self.memory_norm = nnx.LayerNorm(size.width, dtype=dtype, rngs=rngs)
        self.action_norm = nnx.LayerNorm(size.width, dtype=dtype, rngs=rngs)
        small = nnx.initializers.variance_scaling(1e-2, "fan_in", "uniform")
        self.out = Linear(size.width, robot.joints, kernel_init=small, rngs=rngs)
        self.dtype = dtype

    def __call__(
        self,
        scene_points: Float[Array, "*batch N 3"],
        scene_mask: Bool[Array, "*batch N"],
        robot_points: Float[Array, "*batch R 3"],
        joints: Float[Array, "*batch J"],
        goal: Float[Array, "*batch J"],
    ) -> Float[Array, "*batch 10 J"]:
        """The chunk (`chunks.py`) for points [m] in the world frame and joints [rad].

        Points are thinned by a fixed stride: they are in random order, the moving boxes' last, so
        every surface keeps its share.
        """
        size = self.size
        all_points, all_there = scene_points, scene_mask
        stride = scene_points.shape[-2] // size.scene_points
        scene_points, scene_mask = scene_points[..., ::stride, :], scene_mask[..., ::stride]
        robot_points = robot_points[..., :: robot_points.shape[-2] // size.robot_points, :]
        there = jnp.ones(robot_points.shape[:-1], bool)
        q, g, way = (part.astype(self.dtype) for part in joint_inputs(joints, goal, self.arm))
        closeness = []
        if size.sees_goal:
            goal_points = arm_at(goal, size.robot_points, self.arm)
            closeness = [
                jnp.stack(
                    [_closeness(scene_points, arm) for arm in (robot_points, goal_points)], -1
                )
            ]
        groups = [
            self.scene(scene_points, scene_mask, *closeness),
            self.robot(robot_points, there),
            self.current(q)[..., None, :],
            self.goal(g)[..., None, :],
            self.difference(way)[..., None, :],
        ]
        if size.sees_goal:
            groups.append(self.robot(goal_points, there))
        types = self.types[...].astype(self.dtype)
        groups = [tokens + types[i] for i, tokens in enumerate(groups)]
        if size.feelers:
            places = self.places[...].astype(self.dtype)
            for posture, place in zip((joints, goal), places, strict=True):
                centers = world(feeler_points(size.feelers, self.arm), posture, self.arm)
                groups.append(self.feeler(all_points, all_there, centers=centers) + place)
        x = jnp.concatenate(groups, axis=-2)
        for layer in self.encoder:
            x = layer(x)
        memory = self.memory_norm(x)
        actions = self.actions[...].astype(self.dtype)
        x = jnp.broadcast_to(actions, (*x.shape[:-2], *actions.shape))
        for decoding in self.decoder:
            x = decoding(x, memory)
        return self.out(self.action_norm(x).astype(jnp.float32))


def initial(size: ImpactSize, seed: int = 0, robot: Robot = PANDA) -> Parameters:
    """The parameters of an untrained network."""
    return as_functions.initial(ImpactNetwork, size, seed, robot)


def shapes(size: ImpactSize, robot: Robot = PANDA) -> dict[str, Any]:
    """The tree of the parameters, with a shape and type in place of each array.

    Raises ValueError for more feelers than the arm has places for.
    """
    return as_functions.shapes(ImpactNetwork, size, robot)


def apply(
    size: ImpactSize,
    parameters: Parameters,
    scene_points: Float[Array, "*batch N 3"],
    scene_mask: Bool[Array, "*batch N"],
    robot_points: Float[Array, "*batch R 3"],
    joints: Float[Array, "*batch J"],
    goal: Float[Array, "*batch J"],
    *,
    dtype: str = "float32",
    robot: Robot = PANDA,
) -> Float[Array, "*batch 10 J"]:
    """The network of this size with these parameters; see `ImpactNetwork`."""
    network = as_functions.network(ImpactNetwork, size, parameters, dtype, robot)
    return network(scene_points, scene_mask, robot_points, joints, goal)
