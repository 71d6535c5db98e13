"""Inference of IMPACT here against the same network in PyTorch, side by side on the CPU.

    python benchmarks/impact_inference.py [--sizes small full] [--batches 1 64]     (needs torch)

Same weights, same clouds, same outputs: they are compared before anything is timed, and must agree to
1e-4. PyTorch has no CPU kernel for PointNet++'s operations, so its farthest-point sampling and ball query
are tensor operations too (a cumulative count and `searchsorted`); the last row of each pair gives PyTorch
the neighbourhoods for nothing, while ours still finds them. The two take turns within one run. Wall time is
what a user waits; core time is what all threads burn, which other work on the machine disturbs less. On a
machine that is not idle, pin the run to one core (`taskset -c 0`): waiting threads burn time too.
"""

import argparse
import platform
import time

import jax
import jax.numpy as jnp
import numpy as np
import torch
import torch.nn.functional as F

from drpbench.evaluation.run import device_name
from drpbench.policies.impact import (
    ROBOT_POINTS,
    SCENE_POINTS,
    SIZES,
    ImpactSize,
    apply,
    initial,
)
from drpbench.robot import JOINT_LOWER, JOINT_UPPER


class TorchImpact:
    """The same function of the same parameters in PyTorch, with its fused attention."""

    def __init__(self, size: ImpactSize, parameters):
        self.size = size
        self.p = jax.tree.map(lambda leaf: torch.from_numpy(np.array(leaf)), parameters)
        self.transposed: dict[int, torch.Tensor] = {}
        self.given: dict[int, tuple[torch.Tensor, torch.Tensor]] = {}
        """Neighbourhoods by number of tokens, where they are not to be searched."""

    def linear(self, p, x):
        # F.linear wants (out, in), contiguous.
        kernel = self.transposed.setdefault(id(p["kernel"]), p["kernel"].T.contiguous())
        return F.linear(x, kernel, p["bias"])

    def norm(self, p, x):
        return F.layer_norm(x, x.shape[-1:], p["scale"], p["bias"], eps=1e-6)

    def mlp(self, p, x):
        for i in range(len(p["layers"])):
            x = self.linear(p["layers"][i], F.relu(x) if i else x)
        return x

    def attend(self, p, x, memory):
        def split(y):
            return y.unflatten(-1, (self.size.heads, -1)).transpose(-2, -3)

        q = split(self.linear(p["query"], x))
        k, v = map(split, self.linear(p["key_value"], memory).chunk(2, -1))
        y = F.scaled_dot_product_attention(q, k, v)
        return self.linear(p["out"], y.transpose(-2, -3).flatten(-2))

    def feed_forward(self, p, x):
        return self.linear(p["out"], F.relu(self.linear(p["hidden"], x)))

    def tokens(self, p, points, tokens):
        centers, x = self.given.get(tokens) or self.neighbourhoods(points, tokens)
        for i in range(len(p["point_mlp"])):
            x = F.relu(self.linear(p["point_mlp"][i], x))
        x = self.linear(
            p["out"], F.relu(self.norm(p["norm"], self.linear(p["hidden"], x.amax(-2))))
        )
        return x + self.encoding(centers)

    def encoding(self, centers):
        count = self.size.width // 6
        wavelengths = torch.logspace(np.log10(4.0), np.log10(0.1), count)
        phase = centers[..., None] * (2.0 * np.pi / wavelengths)
        waves = torch.cat([phase.sin(), phase.cos()], -1).flatten(-2)
        return F.pad(waves, (0, self.size.width - 6 * count))

    def neighbourhoods(self, points, tokens):
        rows = torch.arange(len(points))
        gap = torch.full(points.shape[:2], torch.inf)
        chosen = []
        for _ in range(tokens):
            chosen.append(gap.argmax(1))
            away = points - points[rows, chosen[-1]][:, None]
            gap = torch.minimum(gap, away.square().sum(-1))
        centers = points[rows[:, None], torch.stack(chosen, 1)]
        away = sum((points[:, None, :, i] - centers[:, :, None, i]).square() for i in range(3))
        rank = (away < self.size.radius**2).to(torch.int32).cumsum(-1, dtype=torch.int32)
        wanted = torch.arange(1, self.size.samples + 1, dtype=torch.int32)
        wanted = torch.where(wanted <= rank[..., -1:], wanted, 1)
        index = torch.searchsorted(rank, wanted)
        near = points[rows[:, None, None], index]
        return centers, (near - centers[:, :, None]) / self.size.radius

    @torch.inference_mode()
    def __call__(self, scene, mask, robot, joints, goal):
        """The chunk; every scene point is taken as there."""
        size, p = self.size, self.p
        q, g = ((x - MIDDLE) / HALF for x in (joints, goal))
        away = goal - joints
        towards = away / away.abs().amax(-1, keepdim=True)
        groups = [
            self.tokens(
                p["scene"], scene[:, :: SCENE_POINTS // size.scene_points], size.scene_tokens
            ),
            self.tokens(
                p["robot"], robot[:, :: ROBOT_POINTS // size.robot_points], size.robot_tokens
            ),
            self.mlp(p["current"], q)[:, None],
            self.mlp(p["goal"], g)[:, None],
            self.mlp(p["difference"], torch.cat([g - q, towards], -1))[:, None],
        ]
        x = torch.cat([tokens + p["types"][i] for i, tokens in enumerate(groups)], 1)
        for i in range(size.encoder_layers):
            layer = p["encoder"][i]
            y = self.norm(layer["norm_1"], x)
            x = x + self.attend(layer["attention"], y, y)
            x = x + self.feed_forward(layer["feed_forward"], self.norm(layer["norm_2"], x))
        memory = self.norm(p["memory_norm"], x)
        x = p["actions"].expand(len(x), -1, -1)
        for i in range(size.decoder_layers):
            layer = p["decoder"][i]
            y = self.norm(layer["norm_1"], x)
            x = x + self.attend(layer["attention"], y, y)
            x = x + self.attend(layer["cross"], self.norm(layer["norm_2"], x), memory)
            x = x + self.feed_forward(layer["feed_forward"], self.norm(layer["norm_3"], x))
        return self.linear(p["out"], self.norm(p["action_norm"], x))


MIDDLE = torch.tensor(0.5 * (JOINT_UPPER + JOINT_LOWER), dtype=torch.float32)
HALF = torch.tensor(0.5 * (JOINT_UPPER - JOINT_LOWER), dtype=torch.float32)


def observed(batch: int):
    """Random clouds on a few faces, about as dense as the benchmark's, and random joints."""
    rng = np.random.default_rng(0)
    scene = rng.uniform(-0.6, 0.6, (batch, SCENE_POINTS, 3))
    face = rng.integers(3, size=scene.shape[:2])
    scene[np.arange(batch)[:, None], np.arange(SCENE_POINTS), face] = rng.choice(
        [-0.5, 0.0, 0.4], face.shape
    )
    robot = rng.uniform(-0.3, 0.3, (batch, ROBOT_POINTS, 3))
    joints = rng.uniform(JOINT_LOWER, JOINT_UPPER, (2, batch, 7))
    mask = np.ones(scene.shape[:2], bool)
    return tuple(
        x if x.dtype == bool else x.astype(np.float32) for x in (scene, mask, robot, *joints)
    )


def neighbourhoods(network: TorchImpact, seen) -> dict:
    size = network.size
    scene, robot = (
        points[:, :: points.shape[1] // used]
        for points, used in ((seen[0], size.scene_points), (seen[2], size.robot_points))
    )
    return {
        size.scene_tokens: network.neighbourhoods(scene, size.scene_tokens),
        size.robot_tokens: network.neighbourhoods(robot, size.robot_tokens),
    }


def seconds(function, *inputs) -> tuple[float, float]:
    """Wall time and core time [s] of one call."""
    wall, core = time.perf_counter(), time.process_time()
    jax.block_until_ready(function(*inputs))
    return time.perf_counter() - wall, time.process_time() - core


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--sizes", nargs="+", choices=SIZES, default=list(SIZES))
    parser.add_argument("--batches", nargs="+", type=int, default=[1, 64])
    parser.add_argument("--repetitions", type=int, default=15)
    arguments = parser.parse_args()
    print(
        f"{device_name()}; {platform.machine()}, jax {jax.__version__}, torch {torch.__version__} on "
        f"{torch.get_num_threads()} threads; ms a sample, median of {arguments.repetitions} turns\n"
    )
    print(
        "| size | batch | PyTorch's neighbourhoods | here: wall | core | PyTorch: wall | core "
        "| PyTorch / here: wall | core |\n|---|---|---|---|---|---|---|---|---|"
    )
    for name in arguments.sizes:
        size = SIZES[name]
        parameters = initial(size)
        # An output layer as large as a trained one's, so that equal outputs mean something.
        parameters["out"]["kernel"] = 10.0 * parameters["out"]["kernel"]
        compiled = jax.jit(lambda p, *seen, size=size: apply(size, p, *seen))
        other = TorchImpact(size, parameters)
        for batch in arguments.batches:
            other.given = {}
            seen = observed(batch)
            ours = tuple(map(jnp.asarray, seen))
            theirs = tuple(map(torch.from_numpy, seen))
            expected = other(*theirs).numpy()
            found = np.asarray(compiled(parameters, *ours))
            apart = np.abs(found - expected).max()
            if apart > 1e-4:
                raise SystemExit(f"{name}, batch {batch}: outputs differ by {apart:.1e}")
            for given in (False, True):
                other.given = neighbourhoods(other, theirs) if given else {}
                turns = [
                    (*seconds(compiled, parameters, *ours), *seconds(other, *theirs))
                    for _ in range(arguments.repetitions)
                ]
                w, c, tw, tc = 1e3 * np.median(turns, axis=0) / batch
                wall, core = np.median([(t[2] / t[0], t[3] / t[1]) for t in turns], axis=0)
                print(
                    f"| {name} | {batch} | {'given' if given else 'found'} | {w:.2f} | {c:.2f} "
                    f"| {tw:.2f} | {tc:.2f} | {wall:.2f} | {core:.2f} |",
                    flush=True,
                )


if __name__ == "__main__":
    main()
