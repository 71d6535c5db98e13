"""IMPACT's network in PyTorch, as a witness of what the one in JAX computes and of how long it
takes.

PyTorch has no CPU kernel for PointNet++'s operations, so its farthest-point sampling and ball query
are tensor operations too: a cumulative count and `searchsorted`.
"""

import jax
import numpy as np
import torch
import torch.nn.functional as F

from drpbench.contract import ROBOT_POINTS, SCENE_POINTS
from drpbench.policies.networks.impact import ImpactSize
from drpbench.robot import PANDA

MIDDLE = torch.tensor(0.5 * (PANDA.joint_upper + PANDA.joint_lower), dtype=torch.float32)
HALF = torch.tensor(0.5 * (PANDA.joint_upper - PANDA.joint_lower), dtype=torch.float32)


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
