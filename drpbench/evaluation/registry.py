"""Policies by name."""

from collections.abc import Callable
from dataclasses import fields, is_dataclass
from typing import Any

from drpbench.baselines import Rmp
from drpbench.policies import DcpRmp, Hold, Policy, Straight

POLICIES: dict[str, tuple[Callable[[], Policy], str]] = {
    "hold": (Hold, "stays where it is: the floor of every task"),
    "straight": (Straight, "the straight line in joint space, blind to the scene"),
    "rmp": (Rmp, "Riemannian motion policies from the point cloud alone"),
}
WRAPPERS: dict[str, tuple[Callable[[Policy], Policy], str]] = {
    "dcp-rmp": (DcpRmp, "gives way to the dynamic closest point; goes over any policy"),
}


class UnknownPolicy(ValueError):
    """No policy of that name; the message lists those there are."""


def make(name: str) -> Policy:
    """The policy that `name` describes: `rmp`, or with wrappers, `straight+dcp-rmp`."""
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
