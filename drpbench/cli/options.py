"""Options that several commands have, and what is refused of them."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from drpbench.errors import InputError, suggested

if TYPE_CHECKING:
    from drpbench.problems import ProblemSet
    from drpbench.results import Result

PolicyName = Annotated[
    str,
    typer.Option(help="A policy of `drpbench list`, or your own: my_package.my_module:MyPolicy."),
]
PolicyArguments = Annotated[
    list[str] | None,
    typer.Option(help="A parameter of the policy, NAME=VALUE; give it again for more."),
]
TimeLimit = Annotated[
    float,
    typer.Option(help="How many seconds a policy outside jit may take for one step of its batch."),
]
ProblemsFrom = Annotated[
    Path | None,
    typer.Option(
        help="The problem set: a file of JSON lines (docs/problems.md), or mpinets-like-v1, which "
        "comes with the package [default: drpbench-v1]"
    ),
]
Seed = Annotated[int, typer.Option(help="The seed of everything random. Compare equal seeds only.")]


def check_limits(time_limit: float, seed: int) -> None:
    """Refuses what no run can have."""
    if not 0.0 < time_limit < float("inf"):
        raise InputError(f"--time-limit {time_limit:g}: expected seconds above 0")
    if not -(2**31) <= seed < 2**31:
        raise InputError(f"--seed {seed}: must fit 32 bits")


def check_out(out: Path) -> None:
    """Refuses what is no name of a result file."""
    from drpbench.results.names import is_result

    if not is_result(out):
        raise InputError(f"--out {out}: the result file must end in .json or .json.gz")


def given_set(path: Path | None) -> "ProblemSet | None":
    """The set in the file that `--problems-from` names, if it names one."""
    from drpbench.problems import load_set

    return None if path is None else load_set(path)


def set_of_results(results: "Mapping[str, Result]", path: Path | None) -> "ProblemSet":
    """The set that the first of the results was made on: in the file named, or in the package."""
    from drpbench.ranking.submission import set_of

    name, result = next(iter(results.items()))
    return set_of(name, result.header, given_set(path))


def shipped_beside(
    results: "Mapping[str, Result]", sizes: Mapping[str, int], protocol: int | None
) -> "dict[str, Result]":
    """The shipped results that stand beside these; says where there is none."""
    from drpbench.ranking import load_dir
    from drpbench.ranking.board import beside, of_protocol
    from drpbench.results.shipped import shipped_results

    own = of_protocol(results, sizes, protocol)
    found = beside(own, load_dir(shipped_results()))
    if not found:
        header = next(iter(own.values())).header
        typer.echo(
            f"no shipped result has these problems of {header.problem_set} by protocol "
            f"{header.protocol}, seed {header.seed}: none stands beside",
            err=True,
        )
    return found


def one_task(text: str, problem_set: "ProblemSet") -> str:
    """The name of a task of the set, however it is written."""
    return parse_tasks(text, problem_set, several=False)[0]


def parse_tasks(text: str, problem_set: "ProblemSet", several: bool = True) -> list[str]:
    """`FDO`, `FDO,DGB` or `all`, in the order named."""
    there = {name.upper(): name for name in problem_set.tasks}
    if several and text.lower() == "all":
        return list(there.values())
    wanted = [part.strip().upper() for part in (text.split(",") if several else [text])]
    if unknown := [name for name in wanted if name not in there]:
        choices = [*there.values(), "all"] if several else list(there.values())
        raise InputError(
            f"there is no task {unknown[0]!r} in {problem_set.name}; "
            f"its tasks are {', '.join(choices)}{suggested(unknown[0], choices)}"
        )
    if len(set(wanted)) < len(wanted):
        raise InputError(f"--task names a task twice: {text}")
    return [there[name] for name in wanted]
