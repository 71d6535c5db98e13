"""Options that several commands have, and what is refused of them."""

from typing import Annotated

import typer

from drpbench.errors import InputError

TASK_NAMES = ("SE", "SAO", "FDO", "GB", "DGB")

PolicyName = Annotated[
    str,
    typer.Option(help="A policy of `drpbench list`, or your own: my_package.my_module:MyPolicy."),
]
PolicyArguments = Annotated[
    list[str] | None,
    typer.Option(help="A parameter of the policy, NAME=VALUE; may be given again."),
]
TimeLimit = Annotated[
    float, typer.Option(help="Seconds a policy outside jit may take for a step of its batch.")
]
Seed = Annotated[int, typer.Option(help="Of everything random. Compare equal seeds only.")]


def check_limits(time_limit: float, seed: int) -> None:
    """Refuses what no run can have."""
    if not 0.0 < time_limit < float("inf"):
        raise InputError(f"--time-limit {time_limit:g}: seconds above 0 are meant")
    if not -(2**31) <= seed < 2**31:
        raise InputError(f"--seed {seed}: must fit 32 bits")
