"""Networks by name: the known ones, those of installed packages, and yours by import path.

A file of weights becomes a policy only with its network, and a user's own network is named beside
the file: `my_package.my_module:MyLearner:weights.safetensors`.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar

from drpbench.contract import observation_spec
from drpbench.policies.networks import Network
from drpbench.policies.weights import NETWORKS, load
from drpbench.robot import PANDA, Robot

from .errors import PolicyError, told
from .imported import check, find, installed, offered

GROUP = "drpbench.learners"
"""The entry-point group that an installed package offers its networks under."""

Kind = TypeVar("Kind", bound=type[Network])


def named(name: str, known: Mapping[str, Kind]) -> Kind:
    """The network of that name: one of `known`, of an installed package, or at an import path.

    Raises PolicyError.
    """
    entries = installed(GROUP)
    if name in known:
        return known[name]
    if ":" in name:
        return _network(name, find(name, "a class of a network"))
    if name in entries:
        return _network(name, offered(entries[name]))
    there = ", ".join([*known, *entries])
    raise PolicyError(
        f"no network {name!r}; there are: {there}, and yours as my_package.my_module:MyLearner"
    )


def _network(name: str, found: Any) -> Any:
    if not (isinstance(found, type) and issubclass(found, Network)):
        raise PolicyError(f"{name}: expected a subclass of drpbench.learning.learner.Learner")
    return found


def policy_of_file(name: str, robot: Robot = PANDA) -> Any:
    """The policy of a file of weights: `FILE` if its network is a known one, or `NETWORK:FILE`.

    Raises PolicyError or WeightsError.
    """
    network, file = split(name)
    if not network:
        return load(Path(file), robot=robot)
    kind = named(network, NETWORKS)
    try:
        policy = load(Path(file), {network: kind}, robot)
    except (PolicyError, ValueError):
        raise
    except Exception as error:  # their own code
        raise PolicyError(f"{network}: making its policy failed: {told(error)}") from None
    check(name, policy, observation_spec(robot))
    return policy


def split(name: str) -> tuple[str, str]:
    """`NETWORK:FILE` as its parts, where NETWORK may hold one colon; without a network ("",
    FILE)."""
    network, _, file = name.partition(":")
    if not file:
        return "", name
    second, colon, rest = file.partition(":")
    # A module's class stands before a second colon.
    return (f"{network}:{second}", rest) if colon and second.isidentifier() else (network, file)
