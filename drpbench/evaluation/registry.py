"""Policies by name."""

from collections.abc import Callable
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

from drpbench.baselines import Rmp
from drpbench.policies import DcpRmp, Hold, Policy, Straight


def _impact(weights: str | Path = "impact") -> Policy:
    """IMPACT with shipped weights, or those of a file. Imports the network only where it is asked for."""
    from drpbench.policies.weights import load

    return load(weights)


def _drp(weights: str | Path = "impact") -> Policy:
    return DcpRmp(_impact(weights))


POLICIES: dict[str, tuple[Callable[[], Policy], str]] = {
    "drp": (_drp, "Deep Reactive Policy: IMPACT with DCP-RMP, the paper's method"),
    "impact": (_impact, "the transformer policy alone, with the best weights there are"),
    "impact-pretrained": (
        lambda: _impact("impact-pretrained"),
        "the same, pretrained and not finetuned",
    ),
    "rmp": (Rmp, "Riemannian motion policies from the point cloud alone"),
    "straight": (Straight, "the straight line in joint space, blind to the scene"),
    "hold": (Hold, "stays where it is: the floor of every task"),
}
FROM_FILE: dict[str, Callable[[Path], Policy]] = {"drp": _drp, "impact": _impact}
"""Those that take weights of the user's: `impact:runs/mine/weights.safetensors`."""
WRAPPERS: dict[str, tuple[Callable[[Policy], Policy], str]] = {
    "dcp-rmp": (DcpRmp, "gives way to the dynamic closest point; goes over any policy"),
}


class UnknownPolicy(ValueError):
    """No policy of that name; the message lists those there are."""


def make(name: str) -> Policy:
    """The policy that `name` describes: `rmp`; with wrappers, `straight+dcp-rmp`; with a file of weights,
    `impact:weights.safetensors`. Raises UnknownPolicy or WeightsError."""
    base, colon, rest = name.partition(":")
    if colon:
        # A path may hold a plus; what is no wrapper at its end belongs to it.
        file, wrappers = rest, []
        while (split := file.rpartition("+"))[2] in WRAPPERS:
            file, wrappers = split[0], [split[2], *wrappers]
        if base not in FROM_FILE:
            raise UnknownPolicy(
                f"{base!r} takes no file of weights; those that do: {', '.join(FROM_FILE)}"
            )
        policy = FROM_FILE[base](Path(file))
    else:
        base, *wrappers = name.split("+")
        if base not in POLICIES:
            raise UnknownPolicy(f"no policy {base!r}; there are: {', '.join(POLICIES)}{_over()}")
        policy = POLICIES[base][0]()
    for wrapper in wrappers:
        if wrapper not in WRAPPERS:
            raise UnknownPolicy(
                f"nothing called {wrapper!r} goes over a policy; there is: {', '.join(WRAPPERS)} "
                f"(as in straight+dcp-rmp)"
            )
        policy = WRAPPERS[wrapper][0](policy)
    return policy


def _over() -> str:
    return "; each also with " + ", ".join(f"+{name}" for name in WRAPPERS)


def parameters(policy: Any, prefix: str = "") -> dict[str, float | int | str | bool]:
    """Every scalar setting of a policy, by dotted name, for a result's header."""
    found: dict[str, float | int | str | bool] = {}
    for field in fields(policy):
        value = getattr(policy, field.name)
        if is_dataclass(value):
            found |= parameters(value, f"{prefix}{field.name}.")
        elif isinstance(value, (bool, int, float, str)):
            found[prefix + field.name] = value
    return found
