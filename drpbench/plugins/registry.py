"""Policies by name."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Any, cast

from drpbench.baselines import Curobo, Mppi, Ompl, Rmp, TestTimeOptimisation, TrajOpt
from drpbench.contract import (
    EPISODE,
    OF_THE_WORLD,
    Episode,
    HostPolicy,
    Policy,
    observation_spec,
)
from drpbench.errors import suggested
from drpbench.policies import DcpRmp, FoldAndWait, Hold, Straight
from drpbench.robot import PANDA, Robot

from .arguments import accepted, read, settings
from .errors import PolicyError, UnknownPolicy
from .host import TIME_LIMIT, Hosted
from .imported import built, check, find, installed, is_host, offered
from .remote import Remote

BEST_WEIGHTS = "impact"
"""Of the shipped ones."""


def _impact(
    weights: str | Path = BEST_WEIGHTS,
    robot: Robot = PANDA,
    control_period: float = EPISODE.period,
) -> Policy:
    """IMPACT with shipped weights, or those of a file. Imports the network only where it is asked
    for."""
    from drpbench.policies.weights import NETWORKS, load

    found: Any = load(weights, {"impact": NETWORKS["impact"]}, robot)
    return replace(found, control_period=control_period)


def _of_file(name: str, /, robot: Robot = PANDA, control_period: float = EPISODE.period) -> Policy:
    """The policy of `FILE` or `NETWORK:FILE`."""
    from .networks import policy_of_file

    policy: Any = policy_of_file(name, robot)
    if any(field.name == "control_period" for field in fields(policy)):
        return replace(policy, control_period=control_period)
    return policy


def _pretrained(robot: Robot = PANDA, control_period: float = EPISODE.period) -> Policy:
    return _impact("impact-pretrained", robot, control_period)


def _drp(
    weights: str | Path = BEST_WEIGHTS,
    robot: Robot = PANDA,
    control_period: float = EPISODE.period,
) -> Policy:
    inner = _impact(weights, robot, control_period)
    return DcpRmp(inner, robot=robot, control_period=control_period)


def _neuralmp(
    weights: str | Path = "neuralmp",
    robot: Robot = PANDA,
    control_period: float = EPISODE.period,
) -> Policy:
    """NeuralMP's architecture with shipped weights, or those of a file."""
    from drpbench.policies.weights import NETWORKS, load

    found: Any = load(weights, {"neuralmp": NETWORKS["neuralmp"]}, robot)
    return replace(found, control_period=control_period)


def _tto(policy: Any, robot: Robot = PANDA, control_period: float = EPISODE.period) -> Policy:
    if not hasattr(policy, "drawn"):
        raise PolicyError("tto: draws ways from a policy that can: expected neuralmp+tto")
    return TestTimeOptimisation(policy, robot=robot, control_period=control_period)


POLICIES: dict[str, tuple[Callable[..., Any], str]] = {
    "drp": (_drp, "Deep Reactive Policy: IMPACT with DCP-RMP, the paper's method"),
    "impact": (_impact, "the transformer policy alone, with the best weights there are"),
    "impact-pretrained": (_pretrained, "the same before it learned from corrections"),
    "rmp": (Rmp, "Riemannian motion policies from the point cloud alone"),
    "neuralmp": (_neuralmp, "NeuralMP's architecture, trained on what IMPACT was, no longer"),
    "mppi": (Mppi, "sampling-based model-predictive control, from the point cloud"),
    "mppi-privileged": (
        partial(Mppi, privileged=True),
        "sampling-based model-predictive control on the obstacle models (privileged)",
    ),
    "trajopt": (TrajOpt, "plans with a trajectory optimiser on the obstacle models (privileged)"),
    "trajopt-vox": (
        partial(TrajOpt, privileged=False),
        "plans with the same optimiser on voxels of the point cloud",
    ),
    "ompl": (
        Ompl,
        "plans with OMPL on the obstacle models; ompl:bitstar names the planner (privileged)",
    ),
    "curobo": (
        Curobo,
        "plans with NVIDIA's cuRobo on the obstacle models, on a GPU of theirs (privileged)",
    ),
    "straight": (Straight, "the straight line in joint space, blind to the scene"),
    "fold-and-wait": (FoldAndWait, "folds away, waits until the boxes are gone, and goes straight"),
    "hold": (Hold, "stays where it is"),
}
FROM_FILE: dict[str, Callable[..., Policy]] = {
    "drp": _drp,
    "impact": _impact,
    "neuralmp": _neuralmp,
}
"""Those that take weights of the user's: `impact:runs/mine/weights.safetensors`."""
WRAPPERS: dict[str, tuple[Callable[..., Policy], str]] = {
    "dcp-rmp": (DcpRmp, "gives way to the dynamic closest point; goes over any policy"),
    "tto": (_tto, "tracks the best of 100 ways that a policy draws beforehand; goes over neuralmp"),
}


@dataclass(frozen=True)
class Choice:
    """A policy ready to run, and the parameters that a result's header states of it."""

    policy: Any
    parameters: dict[str, float | int | str | bool]


def make(name: str) -> Any:
    """The policy that `name` describes, with its own parameters; see `choose`."""
    return choose(name).policy


def choose(
    name: str,
    arguments: Sequence[str] = (),
    time_limit: float = TIME_LIMIT,
    robot: Robot = PANDA,
    episode: Episode = EPISODE,
) -> Choice:
    """The policy that `name` describes: `rmp`; with wrappers, `straight+dcp-rmp`; with a file of
    weights, `impact:weights.safetensors`, and with one of your own network,
    `my_package.my_module:MyLearner:weights.safetensors`; yours by import path,
    `my_package.my_module:MyPolicy`, or by the name under which your installed package offers it; or
    that of another process, `remote:127.0.0.1:5555`.

    `arguments` are keyword parameters for the policy itself, each as "name=value"; `time_limit` [s]
    is what a policy outside jit may take for a control step. Such a policy comes as a Hosted. A
    policy whose factory has a parameter called `robot` or `control_period` gets the arm, or how
    long a control step of the episode is [s].

    Raises PolicyError or WeightsError, each one line.
    """
    world = dict(zip(OF_THE_WORLD, (robot, episode.period), strict=True))
    base, wrappers = split(name)
    factory: Callable[..., Any]
    fixed: dict[str, Any]
    kind, _, rest = base.partition(":")
    if ":" in base and kind in FROM_FILE:
        factory, fixed = FROM_FILE[kind], {"weights": Path(rest)}
    elif ":" in base and kind == "ompl":
        factory, fixed = Ompl, {"planner": rest}
    elif ":" in base and kind == "remote":
        if arguments:
            raise PolicyError("--policy-arg: a remote policy takes its parameters where it runs")
        return _remote(rest, wrappers, time_limit, world)
    elif ":" in base and (kind in POLICIES or kind in installed()):
        raise UnknownPolicy(
            f"{kind!r} takes no file of weights; those that do: {', '.join(FROM_FILE)}"
        )
    elif base.endswith(".safetensors"):
        factory, fixed = partial(_of_file, base), {}
    elif ":" in base:
        return _theirs(base, find(base), arguments, wrappers, time_limit, world)
    elif base in POLICIES:
        factory, fixed = POLICIES[base][0], {}
    elif base in installed():
        return _theirs(base, offered(installed()[base]), arguments, wrappers, time_limit, world)
    else:
        known = [*POLICIES, *installed()]
        if base.isidentifier() and find_spec(base) is not None:
            raise UnknownPolicy(f"{base!r} is a module: append the policy's class, {base}:MyPolicy")
        raise UnknownPolicy(
            f"no policy {base!r}; there are: {', '.join(known)}, and yours as module:Class{_over()}"
            f"{suggested(base, known)}"
        )
    fixed |= accepted(factory, world)
    chosen = read(base, factory, arguments, fixed)
    if is_host(factory):
        planner = cast(Callable[[], HostPolicy], partial(factory, **fixed, **chosen))
        return _planner(planner, wrappers, world)
    policy = _wrapped(factory(**fixed, **chosen), wrappers, world)
    return Choice(policy, parameters(policy))


def at_hand(
    policy: Policy | HostPolicy,
    time_limit: float = TIME_LIMIT,
    robot: Robot = PANDA,
    episode: Episode = EPISODE,
) -> Choice:
    """A policy that is made already, in JAX or on the host, ready to run on this arm.

    `time_limit` [s] is what one on the host may take for a control step. Raises PolicyError, one
    line, for what is no policy.
    """
    name = type(policy).__name__
    check(name, policy, observation_spec(robot))
    if not is_host(policy):
        return Choice(policy, parameters(policy))

    def build() -> HostPolicy:
        raise PolicyError(f"{name} never answered, and an object cannot be made again")

    world = dict(zip(OF_THE_WORLD, (robot, episode.period), strict=True))
    return _hosted(cast(HostPolicy, policy), build, [], {}, time_limit, world)


def split(name: str) -> tuple[str, list[str]]:
    """`straight+dcp-rmp` as its policy and what goes over it, innermost first."""
    if ":" in name:
        # A path may hold a plus; what is no wrapper at its end belongs to it.
        base, wrappers = name, list[str]()
        while (split := base.rpartition("+"))[2] in WRAPPERS:
            base, wrappers = split[0], [split[2], *wrappers]
        return base, wrappers
    base, *wrappers = name.split("+")
    return base, wrappers


def _theirs(
    name: str,
    factory: Callable,
    arguments: Sequence[str],
    wrappers: list[str],
    time_limit: float,
    world: Mapping[str, Any],
) -> Choice:
    fixed = accepted(factory, world)
    chosen = read(name, factory, arguments, fixed)

    def build() -> Any:
        return built(name, factory, fixed | chosen)

    policy = build()
    check(name, policy, observation_spec(world["robot"]))
    own = parameters(policy) if is_dataclass(policy) else settings(factory, chosen, fixed)
    own = _beneath(wrappers, own)
    if not is_host(policy):
        policy = _wrapped(policy, wrappers, world)
        return Choice(policy, parameters(policy) | own)
    return _hosted(policy, build, wrappers, own, time_limit, world)


def _planner(
    build: Callable[[], HostPolicy], wrappers: list[str], world: Mapping[str, Any]
) -> Choice:
    """A host policy of ours, which keeps its own time."""
    policy = build()
    own = _beneath(wrappers, parameters(policy))
    return _hosted(policy, build, wrappers, own, None, world)


def _remote(
    address: str, wrappers: list[str], time_limit: float, world: Mapping[str, Any]
) -> Choice:
    def connect() -> Remote:
        return Remote(address, time_limit)

    policy = connect()
    own = _beneath(wrappers, policy.parameters)
    return _hosted(policy, connect, wrappers, own, time_limit, world, slack=5.0)


def _beneath(wrappers: list[str], own: Mapping[str, Any]) -> dict[str, Any]:
    """A policy's own parameters, by the names that they have under its wrappers."""
    return {"policy." * len(wrappers) + key: value for key, value in own.items()}


def hosted_over(
    policy: HostPolicy,
    build: Callable[[], HostPolicy],
    wrappers: list[str],
    stated: Mapping[str, Any],
    time_limit: float,
    world: Mapping[str, Any],
) -> Choice:
    """A policy behind a socket, with wrappers over it, as if it were in this process: with the
    parameters that the other one states of it, its host's among them."""
    own = _beneath(wrappers, {key: v for key, v in stated.items() if key[:5] != "host."})
    choice = _hosted(policy, build, wrappers, own, time_limit, world, slack=5.0)
    told = {key: value for key, value in choice.parameters.items() if key[:5] != "host."}
    return Choice(choice.policy, told | {key: v for key, v in stated.items() if key[:5] == "host."})


def _hosted(
    policy: HostPolicy,
    build: Callable[[], HostPolicy],
    wrappers: list[str],
    own: dict[str, Any],
    time_limit: float | None,
    world: Mapping[str, Any],
    slack: float = 0.0,
) -> Choice:
    """`slack` [s] is for a policy that keeps the limit itself, and should be the one to say so."""
    limit = None if time_limit is None else time_limit + slack
    hosted = Hosted(policy, build, lambda shown: _wrapped(shown, wrappers, world), limit)
    over = {
        key: value for key, value in parameters(hosted.shown).items() if "privileged" not in key
    }
    told: dict[str, Any] = {"host.arrays": hosted.arrays}
    if time_limit is not None:
        told["host.time_limit"] = time_limit
    return Choice(hosted, over | own | told)


def _wrapped(policy: Any, wrappers: list[str], world: Mapping[str, Any]) -> Any:
    for wrapper in wrappers:
        if wrapper not in WRAPPERS:
            raise UnknownPolicy(
                f"nothing called {wrapper!r} goes over a policy; there is: {', '.join(WRAPPERS)} "
                f"(as in straight+dcp-rmp){suggested(wrapper, WRAPPERS)}"
            )
        wrap = WRAPPERS[wrapper][0]
        policy = wrap(policy, **accepted(wrap, world))
    return policy


def _over() -> str:
    return "; each also with " + ", ".join(f"+{name}" for name in WRAPPERS)


def parameters(policy: Any, prefix: str = "") -> dict[str, float | int | str | bool]:
    """Every scalar setting of a policy, by dotted name, for a result's header.

    What is the world's, its arm and its control period, is none; nor is what is UNSTATED.
    """
    found: dict[str, float | int | str | bool] = {}
    for field in fields(policy) if is_dataclass(policy) else ():
        if field.name in OF_THE_WORLD or not field.metadata.get("stated", True):
            continue
        value = getattr(policy, field.name)
        if is_dataclass(value):
            found |= parameters(value, f"{prefix}{field.name}.")
        elif isinstance(value, (bool, int, float, str)):
            found[prefix + field.name] = value
    return found
