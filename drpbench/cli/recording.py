"""What the command line knows of recordings. Everything heavy is imported inside."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from drpbench.cli.extras import require
from drpbench.errors import InputError

from .options import ProblemsFrom, set_of_results

if TYPE_CHECKING:
    from drpbench.evaluation.progress import Bars
    from drpbench.problems import ProblemSet
    from drpbench.recording.recorder import Recorder
    from drpbench.recording.video import Shot


def with_all(arguments: Sequence[str]) -> list[str]:
    """`--record` alone as `--record all`: typer knows no option whose value may be left out."""
    given = list(arguments)
    for place, argument in enumerate(given):
        if argument == "--record" and (place + 1 == len(given) or given[place + 1][:1] == "-"):
            given.insert(place + 1, "all")
            break
    return given


def parse_count(text: str | None) -> int | None:
    """How many episodes of each task `--record` asks for; None for all of them."""
    if text in (None, "all"):
        return None
    if not text.isdecimal() or int(text) < 1:
        raise InputError(
            f"--record {text}: expected a number of episodes of each task (5), or nothing for all"
        )
    return int(text)


def recorder(
    out: Path,
    count: int | None,
    wanted: Mapping[str, Sequence[int] | None],
    problem_set: ProblemSet,
    progress: Bars,
) -> Recorder:
    """What a run shows its batches to, to have MCAP files in a folder beside `out`: of the first
    `count` of the instances wanted of each task (None: all of a task that has so many in all)."""
    require("record", "--record")
    from drpbench.recording.recorder import Recorder
    from drpbench.results.names import recordings_folder

    sizes = problem_set.counts
    ids = {task: range(sizes[task]) if ids is None else ids for task, ids in wanted.items()}
    only = {task: set(some[:count]) for task, some in ids.items()}
    progress.files(sum(map(len, only.values())))
    return Recorder(recordings_folder(out), only, out, problem_set, progress.wrote)


def _say_what_it_is(path: Path) -> None:
    from drpbench.recording.recorded import read_recording

    found = read_recording(path)
    of = found.about
    typer.echo(
        f"{path}: whole; {of['task']} {of['id']} ({of['family']}) with {of['policy']}, seed "
        f"{of['seed']}, "
        f"{of['problem_set']}; {found.seconds:.1f} s, {found.messages} messages"
    )


def _shot(shown: dict[str, Any], grid: bool) -> Shot:
    """How a video shows it, where it is not as by default."""
    from drpbench.recording.video import GRID, Shot

    if "size" in shown:
        found = re.fullmatch(r"(\d{1,5})x(\d{1,5})", shown["size"])
        if not found:
            raise InputError(f"--size {shown['size']}: expected WIDTHxHEIGHT, such as 960x720")
        shown = shown | {"size": (int(found[1]), int(found[2]))}
    return replace(GRID if grid else Shot(), **shown)


def replay(
    result: Annotated[
        Path, typer.Argument(help="The result file of a run; or an MCAP file, to check it.")
    ],
    id: Annotated[int | None, typer.Option(help="The number of the instance.")] = None,
    task: Annotated[
        str | None, typer.Option(help="The task, where the result has several.")
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="The folder to write to [default: named after the result]")
    ] = None,
    video: Annotated[bool, typer.Option("--video", help="Make a video as well.")] = False,
    grid: Annotated[
        int | None,
        typer.Option(help="Make one video of this many episodes instead, spread evenly."),
    ] = None,
    fps: Annotated[
        float | None, typer.Option(help="Frames a second of the video [default: 30, of a grid 15]")
    ] = None,
    speed: Annotated[
        float | None, typer.Option(help="How many times the true speed [default: 1]")
    ] = None,
    size: Annotated[
        str | None,
        typer.Option(
            help="Pixels of the video, multiples of 8 [default: 960x720, of a grid 1280x960]"
        ),
    ] = None,
    camera: Annotated[
        str | None,
        typer.Option(
            help="corner (the default), front, back, left, right, top; contact: close to the first "
            "contact; or AZIMUTH,ELEVATION,DISTANCE."
        ),
    ] = None,
    problems_from: ProblemsFrom = None,
) -> None:
    """Show an episode again, as an MCAP file for Foxglove or as a video.

    The run's trajectories are used if there are any; otherwise the episode runs again. Files that
    are there are replaced.
    """
    require("record", "drpbench replay")
    if result.suffix == ".mcap":
        _say_what_it_is(result)
        return
    if (id is None) == (grid is None):
        raise InputError("say which episode with --id 17, or how many for one video with --grid 16")
    wanted = {"fps": fps, "speed": speed, "size": size, "camera": camera}
    shown = {name: value for name, value in wanted.items() if value is not None}
    if shown and not (video or grid):
        raise InputError(f"--{next(iter(shown))} is of a video: add --video, or --grid 16")
    from drpbench.compile import use_cache

    use_cache()
    shot = _shot(shown, grid is not None)
    from drpbench.recording import Replayer
    from drpbench.recording.recorder import Recorder
    from drpbench.results import load
    from drpbench.results.names import recordings_folder

    from .terminal import console_of

    run = load(result)
    header, folder = run.header, out or recordings_folder(result)
    console = console_of()
    with console.status("replaying") as status:
        done = 0

        def ran(steps: int) -> None:
            nonlocal done
            done += steps
            status.update(f"running again: {done} control steps")

        def drew(frames: int, of: int) -> None:
            status.update(f"drawing: {frames} of {of} frames")

        def wrote(path: Path) -> None:
            console.print(f"wrote {path}", soft_wrap=True)

        problem_set = set_of_results({str(result): run}, problems_from)
        replayer = Replayer(run, result, ran, problem_set)
        task = task and task.upper()
        if grid is not None:
            rows = replayer.spread(task, grid)
        else:
            assert id is not None, "either an id or a grid was asked for"
            rows = [replayer.row(task, id)]
        if video or grid:
            from drpbench.recording.offscreen import choose_platform
            from drpbench.recording.video import film, film_grid, suffix

            choose_platform()  # before anything takes long
        found = replayer.replay(rows)
        for replay in found:
            if replay.remark:
                console.print(replay.remark, style="yellow", soft_wrap=True)
        episodes = [replay.episode for replay in found]
        if grid is not None:
            path = folder / f"{rows[0].task}-grid-{grid}{suffix()}"
            film_grid(path, episodes, shot, drew)
            wrote(path)
            return
        wrote(Recorder(folder, problem_set=problem_set).write(header, episodes[0]))
        if video:
            path = folder / f"{episodes[0].name}{suffix()}"
            film(path, episodes[0], shot, drew)
            wrote(path)
