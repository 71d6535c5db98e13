"""A run once more as it was run: the same policy with the same parameters, seed and batch size."""

import tempfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from drpbench.contract import PROTOCOL
from drpbench.plugins.errors import PolicyError
from drpbench.plugins.host import TIME_LIMIT
from drpbench.plugins.isolation import is_ours, isolated
from drpbench.plugins.registry import Choice, choose
from drpbench.problems import ProblemSet
from drpbench.ranking.submission import set_of
from drpbench.results import Header, Result, ResultsError
from drpbench.results.schema import Scalar

from .progress import RunProgress
from .run import KEPT, Request, Watch, run

_HOST = "host."  # what a header says of a policy outside jit, besides its own parameters
_INNER = "policy."  # before the parameters of a policy that another one goes over


def rerun(
    name: str,
    header: Header,
    problems: Mapping[str, Sequence[int]],
    progress: RunProgress,
    watch: Watch | None = None,
    batch_size: int | None = None,
    problem_set: ProblemSet | None = None,
) -> Result:
    """Runs problems (ids by task) again as a result's header says; nothing is left on the disk.

    A policy that does not come with drpbench is kept in a process of its own: what it does to the
    program is not done to this one.

    Args:
        name: what a message should call the result, usually its file.
        problem_set: the one that the result was made on, where it does not come with the package.
        batch_size: another than the header's.

    Raises:
        ResultsError: the policy cannot be made with the parameters that the header states, or the
            problems are not those that it was made on.
        PolicyError, WeightsError: it cannot be made at all, or is lost on the way.
    """
    if header.protocol != PROTOCOL:
        raise ResultsError(
            f"{name}: expected a run of protocol {PROTOCOL}, got protocol {header.protocol}; "
            "this drpbench cannot run it again as it was"
        )
    chosen = set_of(name, header, problem_set)
    kept_out = not is_ours(header.policy) and not header.policy.startswith("remote:")
    with tempfile.TemporaryDirectory(prefix="drpbench-") as folder:
        request = Request(
            policy=header.policy,
            problems=problems,
            problem_set=chosen,
            out=Path(folder) / "again.json",
            policy_arguments=arguments_of(name, header, _looked if kept_out else choose),
            isolated=kept_out,
            seed=header.seed,
            batch_size=batch_size or header.batch_size,
            watch=watch,
            time_limit=_time_limit(header),
        )
        try:
            again = run(request, progress)
        except PolicyError as error:  # its rows go with the folder: there is nothing to resume
            raise PolicyError(str(error).removesuffix(KEPT)) from None
    _require_same_policy(name, header, again.header.policy_parameters, again.header.privileged)
    return again


def _time_limit(header: Header) -> float:
    limit = header.policy_parameters.get(f"{_HOST}time_limit")
    return float(limit) if isinstance(limit, (int, float)) else TIME_LIMIT


def _looked(name: str, arguments: Sequence[str], time_limit: float) -> Choice:
    """What `choose` finds, without the policy's code in this process. It can be asked nothing."""
    with isolated(name, arguments, time_limit) as choice:
        return choice


def arguments_of(
    name: str, header: Header, look: Callable[[str, Sequence[str], float], Choice] = choose
) -> list[str]:
    """The `--policy-arg`s under which the policy has the parameters that a result's header states.
    `look` finds it.

    Raises ResultsError, naming the result as `name`, where there are none such; PolicyError or
    WeightsError where the policy cannot be made at all.
    """
    if header.policy.startswith("remote:"):
        return []  # its parameters are set where it runs; it may answer one connection only
    stated, usual = header.policy_parameters, dict[str, Scalar | list[Scalar]]()
    try:
        usual |= dict(look(header.policy, (), _time_limit(header)).parameters)
    except PolicyError as error:
        if "needs a value" not in str(error):
            raise
    own, usual = _own(stated), _own(usual)
    arguments = [f"{key}={value}" for key, value in own.items() if usual.get(key, _ABSENT) != value]
    try:
        choice = look(header.policy, arguments, _time_limit(header))
    except PolicyError as error:
        raise ResultsError(
            f"{name}: {header.policy} cannot be made as it was run: {error}"
        ) from None
    _require_same_policy(name, header, choice.parameters, choice.policy.privileged)
    return arguments


def _require_same_policy(
    name: str, header: Header, parameters: Mapping[str, Scalar | list[Scalar]], privileged: bool
) -> None:
    stated = header.policy_parameters | {"privileged": header.privileged}
    here = {**parameters, "privileged": privileged}
    for key in sorted(stated.keys() | here.keys()):
        was, now = stated.get(key, _ABSENT), here.get(key, _ABSENT)
        if was != now:
            raise ResultsError(
                f"{name}: {header.policy} was run with {key} {was}, and is {now} here; "
                "it cannot be run again as it was"
            )


_ABSENT = "absent"


def _own(parameters: Mapping[str, Scalar | list[Scalar]]) -> dict[str, Scalar | list[Scalar]]:
    """The parameters of the innermost policy: those of what goes over it, and of its host, left
    out."""
    depth = max((len(_prefix(key)) for key in parameters), default=0)
    inner = {key[depth:]: value for key, value in parameters.items() if len(_prefix(key)) == depth}
    return {key: value for key, value in inner.items() if not key.startswith(_HOST)}


def _prefix(key: str) -> str:
    """The "policy." of `key`, as often as it stands there."""
    rest = key
    while rest.startswith(_INNER):
        rest = rest.removeprefix(_INNER)
    return key[: len(key) - len(rest)]
