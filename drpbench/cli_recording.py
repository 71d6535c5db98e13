"""The command that shows episodes again. Everything heavy is imported inside."""

from pathlib import Path
from typing import Annotated

import typer

from drpbench.refused import Refused


def replay(
    result: Annotated[Path, typer.Argument(help="Result file of a run.")],
    id: Annotated[int | None, typer.Option(help="Which instance.")] = None,
    task: Annotated[
        str | None, typer.Option(help="Of which task, where the result has several.")
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="Folder to write to [default: named after the result]")
    ] = None,
    video: Annotated[bool, typer.Option("--video", help="Make a video as well.")] = False,
    grid: Annotated[
        int | None, typer.Option(help="Instead: one video of so many episodes, spread evenly.")
    ] = None,
) -> None:
    """Show an episode again: an MCAP file to open in Foxglove, or a video.

    Taken from the run's trajectories where there are any; else the episode is run again. Files that are
    there are replaced.
    """
    if (id is None) == (grid is None):
        raise Refused("say which episode with --id 17, or how many for one video with --grid 16")
    from drpbench.compile import use_cache

    use_cache()
    from rich.console import Console

    from drpbench.evaluation import load
    from drpbench.recording import Recorder, Replayer

    run = load(result)
    header, folder = run.header, out or result.with_suffix("")
    console = Console()
    with console.status("replaying") as status:
        done = 0

        def ran(steps: int) -> None:
            nonlocal done
            done += steps
            status.update(f"running again: {done} control steps")

        def drew(frames: int, of: int) -> None:
            status.update(f"drawing: {frames} of {of} frames")

        def wrote(path: Path) -> None:
            console.print(f"wrote {path}", highlight=False, soft_wrap=True)

        if video or grid:
            from drpbench.recording.offscreen import choose_platform
            from drpbench.recording.video import film, film_grid, suffix

            choose_platform()  # before anything takes long
        replayer = Replayer(run, result, ran)
        task = task and task.upper()
        rows = [replayer.row(task, id)] if grid is None else replayer.spread(task, grid)
        found = replayer.replay(rows)
        for replay in found:
            if replay.remark:
                console.print(replay.remark, style="yellow", highlight=False, soft_wrap=True)
        episodes = [replay.episode for replay in found]
        if grid is not None:
            path = folder / f"{rows[0].task}-grid-{grid}{suffix()}"
            film_grid(path, episodes, advanced=drew)
            wrote(path)
            return
        recorder = Recorder(folder, header.policy, header.policy_parameters, header.seed)
        wrote(recorder.write(episodes[0]))
        if video:
            path = folder / f"{episodes[0].name}{suffix()}"
            film(path, episodes[0], advanced=drew)
            wrote(path)
