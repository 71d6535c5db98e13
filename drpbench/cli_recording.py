"""The command that shows episodes again. Everything heavy is imported inside."""

from pathlib import Path
from typing import Annotated

import typer


def replay(
    result: Annotated[Path, typer.Argument(help="Result file of a run.")],
    id: Annotated[int, typer.Option(help="Which instance.")],
    task: Annotated[
        str | None, typer.Option(help="Of which task, where the result has several.")
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="Folder to write to [default: named after the result]")
    ] = None,
) -> None:
    """Show an episode again: an MCAP file to open in Foxglove.

    Taken from the run's trajectories where there are any; else the episode is run again.
    """
    from drpbench.compile import use_cache

    use_cache()
    from rich.console import Console

    from drpbench.evaluation import load
    from drpbench.recording import Recorder, Replayer

    run = load(result)
    header = run.header
    folder = out or result.with_suffix("")
    console = Console()
    with console.status("replaying") as status:
        done = 0

        def advanced(steps: int) -> None:
            nonlocal done
            done += steps
            status.update(f"running again: {done} control steps")

        replayer = Replayer(run, result, advanced)
        row = replayer.row(task and task.upper(), id)
        found = replayer.replay([row])[0]
        if found.remark:
            console.print(found.remark, style="yellow", highlight=False, soft_wrap=True)
        recorder = Recorder(folder, header.policy, header.policy_parameters, header.seed)
        console.print(f"wrote {recorder.write(found.episode)}", highlight=False, soft_wrap=True)
