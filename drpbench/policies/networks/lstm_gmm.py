"""NeuralMP's network: a PointNet++ of scene, arm and goal arm in one cloud, an LSTM over a few
control steps, and a mixture of Gaussians over the next joint motion.

    cloud   = [arm, 0; scene, 1; arm at its goal, 2]
    token   = MLP(set abstraction(set abstraction(set abstraction(cloud))))
    mixture = linear(LSTM(token, q, q_goal, ...))

After Dalal et al., Neural MP (arXiv 2409.05864), with the sizes of its released configuration. What
differs is what IMPACT has here too, so that the two can be compared: the joints come with the way
to the goal and its direction, and the action is in the units of a chunk (`chunks.py`). Means are
not squashed, for those units know no bound.
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
from .arm import arm_at, joint_inputs
from .as_functions import Parameters as Parameters
from .gaussian_mixture import GaussianMixture
from .layers import Linear, greatest
from .lstm_gmm_size import LstmGmmSize
from .set_abstraction import farthest_points, gather, in_pieces, neighbourhoods

State = Float[Array, "*batch 2 layers width"]
"""Of the LSTM: each layer's output and its cell. Zeros before the first step."""

_GROUPS = 16  # of a group norm, at most


def _groups(width: int) -> int:
    """Of a norm over so many channels: a group of one would know nothing of its own."""
    return _GROUPS if width % _GROUPS == 0 and width > 2 * _GROUPS else 1


class SharedMlp(nnx.Module):
    """One MLP for all points of a group, and the maximum over the group."""

    def __init__(self, inputs: int, widths: tuple[int, ...], dtype: DTypeLike, rngs: nnx.Rngs):
        sizes = (inputs, *widths)
        self.layers = nnx.List(
            Linear(a, b, dtype=dtype, rngs=rngs) for a, b in zip(sizes, sizes[1:], strict=False)
        )
        self.dtype = dtype

    def __call__(self, x: Float[Array, "*batch S C"]) -> Float[Array, "*batch D"]:
        x = x.astype(self.dtype)
        for layer in self.layers[:-1]:
            x = nnx.relu(layer(x))
        # ReLU keeps order, so it may follow the maximum.
        return nnx.relu(greatest(self.layers[-1](x)))


class LstmGmmNetwork(nnx.Module):
    """The network as a Flax module; `step` and `unrolled` are the same as pure functions.

    Computes in `dtype`; parameters, joints, positions and the mixture are float32.
    """

    def __init__(
        self,
        size: LstmGmmSize,
        rngs: nnx.Rngs,
        dtype: DTypeLike = jnp.float32,
        robot: Robot = PANDA,
    ):
        self.size, self.arm, self.dtype = size, robot, dtype
        self.first = SharedMlp(3 + 1, size.first_mlp, dtype, rngs)
        self.second = SharedMlp(3 + size.first_mlp[-1], size.second_mlp, dtype, rngs)
        self.whole = SharedMlp(3 + size.second_mlp[-1], size.whole_mlp, dtype, rngs)
        widths = (size.whole_mlp[-1], *size.scene_mlp)
        self.dense = nnx.List(
            Linear(a, b, dtype=dtype, rngs=rngs) for a, b in zip(widths, widths[1:], strict=False)
        )
        self.norms = nnx.List(
            nnx.GroupNorm(width, _groups(width), dtype=dtype, rngs=rngs)
            for width in size.scene_mlp[:-1]
        )
        inputs = (widths[-1] + 4 * robot.joints, *[size.lstm_width] * (size.lstm_layers - 1))
        self.gates = nnx.List(
            Linear(seen + size.lstm_width, 4 * size.lstm_width, dtype=dtype, rngs=rngs)
            for seen in inputs
        )
        small = nnx.initializers.variance_scaling(1e-2, "fan_in", "uniform")
        outputs = size.modes * (1 + 2 * robot.joints)
        self.out = Linear(size.lstm_width, outputs, kernel_init=small, rngs=rngs)

    def __call__(
        self,
        scene_points: Float[Array, "*batch N 3"],
        scene_mask: Bool[Array, "*batch N"],
        robot_points: Float[Array, "*batch R 3"],
        joints: Float[Array, "*batch J"],
        goal: Float[Array, "*batch J"],
        state: State,
    ) -> tuple[GaussianMixture, State]:
        """The next action and the state after it, for points [m] in the world frame and joints
        [rad]; points are thinned as IMPACT's are."""
        seen = self.look(scene_points, scene_mask, robot_points, joints, goal)
        return self.go_on(seen, state)

    def look(
        self,
        scene_points: Float[Array, "*batch N 3"],
        scene_mask: Bool[Array, "*batch N"],
        robot_points: Float[Array, "*batch R 3"],
        joints: Float[Array, "*batch J"],
        goal: Float[Array, "*batch J"],
    ) -> Float[Array, "*batch C"]:
        """What the LSTM sees in one control step."""
        size = self.size
        stride = scene_points.shape[-2] // size.scene_points
        scene, mask = scene_points[..., ::stride, :], scene_mask[..., ::stride]
        arm = robot_points[..., :: robot_points.shape[-2] // size.arm_points, :]
        parts = (arm, scene, arm_at(goal, size.arm_points, self.arm))
        there = jnp.ones(arm.shape[:-1], bool)
        points = jnp.concatenate(parts, axis=-2)
        mask = jnp.concatenate([there, mask, there], axis=-1)
        mark = np.repeat(np.arange(3, dtype=np.float32), [part.shape[-2] for part in parts])
        which = jnp.broadcast_to(jnp.asarray(mark)[:, None], (*mask.shape, 1))

        batch = mask.shape[:-1]
        flat = [x.reshape(-1, *x.shape[len(batch) :]) for x in (points, mask, which)]
        x = self._token(*flat)
        for place, layer in enumerate(self.dense):
            x = layer(x)
            if place < len(self.norms):
                x = nnx.leaky_relu(self.norms[place](x))
        x = x.reshape(*batch, -1)
        told = joint_inputs(joints, goal, self.arm)
        return jnp.concatenate([x, *(part.astype(self.dtype) for part in told)], axis=-1)

    def _token(
        self,
        points: Float[Array, "batch N 3"],
        mask: Bool[Array, "batch N"],
        which: Float[Array, "batch N 1"],
    ) -> Float[Array, "batch C"]:
        """PointNet++: of balls, of balls of balls, of the whole."""
        size = self.size
        near = gather(points, farthest_points(points, mask, size.first_tokens))

        def abstracted(
            layer: SharedMlp, radius: float, samples: int, centers: Array, *cloud: Array
        ) -> Array:
            def tokens(centers: Array, points: Array, mask: Array, features: Array) -> Array:
                return layer(neighbourhoods(points, mask, centers, radius, samples, features))

            return in_pieces(tokens, centers.shape[-2] * samples, centers, *cloud)

        near_by = size.first_radius, size.first_samples
        x = abstracted(self.first, *near_by, near, points, mask, which)
        far = near[..., : size.second_tokens, :]  # the farthest of the farthest come first
        there = jnp.ones(near.shape[:-1], bool)
        near_by = size.second_radius, size.second_samples
        x = abstracted(self.second, *near_by, far, near, there, x.astype(jnp.float32))
        return self.whole(jnp.concatenate([far.astype(x.dtype), x], axis=-1))

    def go_on(self, seen: Float[Array, "*batch C"], state: State) -> tuple[GaussianMixture, State]:
        """One step of the LSTM, and the mixture it ends in."""
        x, after = seen, []
        for layer, gate in enumerate(self.gates):
            hidden, cell = state[..., 0, layer, :], state[..., 1, layer, :]
            both = jnp.concatenate([x, hidden.astype(x.dtype)], axis=-1)
            take, keep, new, give = jnp.split(gate(both).astype(jnp.float32), 4, axis=-1)
            # Keeps at first: a cell that forgets everything learns slowly.
            cell = nnx.sigmoid(keep + 1.0) * cell + nnx.sigmoid(take) * jnp.tanh(new)
            hidden = nnx.sigmoid(give) * jnp.tanh(cell)
            after.append(jnp.stack([hidden, cell], axis=-2))
            x = hidden.astype(self.dtype)
        size, joints = self.size, self.arm.joints
        out = self.out(x.astype(jnp.float32))
        logits, rest = out[..., : size.modes], out[..., size.modes :]
        mean, scale = jnp.split(rest.reshape(*rest.shape[:-1], size.modes, 2 * joints), 2, axis=-1)
        mixture = GaussianMixture(logits, mean, nnx.softplus(scale) + size.least_scale)
        return mixture, jnp.stack(after, axis=-2)


def initial(size: LstmGmmSize, seed: int = 0, robot: Robot = PANDA) -> Parameters:
    """The parameters of an untrained network."""
    return as_functions.initial(LstmGmmNetwork, size, seed, robot)


def shapes(size: LstmGmmSize, robot: Robot = PANDA) -> dict[str, Any]:
    """The tree of the parameters, with a shape and type in place of each array."""
    return as_functions.shapes(LstmGmmNetwork, size, robot)


def start(size: LstmGmmSize, batch: tuple[int, ...] = ()) -> Float[Array, "*batch 2 layers width"]:
    """The LSTM's state before its first step."""
    return jnp.zeros((*batch, 2, size.lstm_layers, size.lstm_width))


def step(
    size: LstmGmmSize,
    parameters: Parameters,
    scene_points: Float[Array, "*batch N 3"],
    scene_mask: Bool[Array, "*batch N"],
    robot_points: Float[Array, "*batch R 3"],
    joints: Float[Array, "*batch J"],
    goal: Float[Array, "*batch J"],
    state: State,
    *,
    robot: Robot = PANDA,
) -> tuple[GaussianMixture, State]:
    """One control step of the network of this size with these parameters."""
    network = as_functions.network(LstmGmmNetwork, size, parameters, robot=robot)
    return network(scene_points, scene_mask, robot_points, joints, goal, state)


def unrolled(
    size: LstmGmmSize,
    parameters: Parameters,
    scene_points: Float[Array, "*batch H N 3"],
    scene_mask: Bool[Array, "*batch H N"],
    robot_points: Float[Array, "*batch H R 3"],
    joints: Float[Array, "*batch H J"],
    goal: Float[Array, "*batch H J"],
    *,
    dtype: str = "float32",
    robot: Robot = PANDA,
) -> GaussianMixture:
    """The mixtures of H control steps in a row, the LSTM beginning anew: of shape (*batch, H)."""
    network = as_functions.network(LstmGmmNetwork, size, parameters, dtype, robot)
    seen = network.look(scene_points, scene_mask, robot_points, joints, goal)
    state, mixtures = start(size, seen.shape[:-2]), []
    for at in range(seen.shape[-2]):
        mixture, state = network.go_on(seen[..., at, :], state)
        mixtures.append(mixture)
    return jax.tree.map(lambda *each: jnp.stack(each, axis=len(seen.shape) - 2), *mixtures)
