"""The command that serves the viewer. Everything heavy is imported inside."""

from typing import Annotated

import typer

from drpbench.errors import InputError

from .options import (
    PolicyArguments,
    PolicyName,
    ProblemsFrom,
    Seed,
    TimeLimit,
    check_limits,
    given_set,
    one_task,
)


def view(
    task: Annotated[str, typer.Option(help="The task.")] = "FDO",
    policy: PolicyName = "drp",
    policy_arg: PolicyArguments = None,
    time_limit: TimeLimit = 10.0,
    id: Annotated[int, typer.Option(help="The number of the first problem.")] = 0,
    problems_from: ProblemsFrom = None,
    seed: Seed = 0,
    host: Annotated[
        str, typer.Option(help="The address to serve at; 0.0.0.0 serves other machines too.")
    ] = ("127.0.0.1"),
    port: Annotated[
        int, typer.Option(help="The port; if it is taken, the next free one is used.")
    ] = 8080,
) -> None:
    """Watch a policy in the browser, and put things in its way (extra `viewer`)."""
    if not 0 < port < 65536:
        raise InputError(f"--port {port}: expected a number from 1 to 65535")
    check_limits(time_limit, seed)
    try:
        import viser  # noqa: F401
    except ImportError:
        raise InputError(
            "the viewer needs viser, which is not installed: pip install 'drpbench[viewer]'"
        ) from None
    from drpbench.problems import load_set

    problem_set = given_set(problems_from) or load_set()
    name = one_task(task, problem_set)
    problems = problem_set.task(name)
    if not 0 <= id < problems.count:
        raise InputError(
            f"--id {id}: there is no such problem in {name}; ids go from 0 to {problems.count - 1}"
        )

    from drpbench.compile import use_cache

    use_cache()
    from drpbench.evaluation.run import world_of
    from drpbench.plugins.registry import choose
    from drpbench.viewer import Simulation
    from drpbench.viewer.page import Page

    from .terminal import console_of

    console = console_of()
    choice = choose(policy, policy_arg or (), time_limit)
    simulation = Simulation(world_of(problem_set, name), choice.policy, problems, seed)
    page = None
    try:
        with console.status(
            f"compiling {name} with {policy}: half a minute the first time"
        ) as told:
            for done in simulation.compile(id):
                told.update(f"compiling: {done} is ready")
        page = Page(simulation, policy, host, port)
        if page.port != port:
            console.print(f"port {port} is taken", style="yellow")
        console.print(f"{page.address}  (Ctrl-C ends it)", soft_wrap=True)
        page.run()
    except KeyboardInterrupt:
        console.print()
    finally:
        if page:
            page.close()
