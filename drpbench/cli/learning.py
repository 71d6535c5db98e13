"""The commands that make demonstrations and train. Everything heavy is imported inside."""

from pathlib import Path
from typing import Annotated

import typer

from drpbench.cli.extras import require
from drpbench.errors import InputError


def _require_at_least(least: int, **options: int | None) -> None:
    for name, number in options.items():
        if number is not None and number < least:
            raise InputError(f"--{name.replace('_', '-')} {number}: must be at least {least}")


def data(
    out: Annotated[Path, typer.Option(help="The folder to write to, or to add to.")],
    count: Annotated[int, typer.Option(help="How many problems to draw in all.")] = 10240,
    first: Annotated[
        int, typer.Option(help="The number of the first problem; another run takes other numbers.")
    ] = 0,
    workers: Annotated[
        int | None, typer.Option(help="How many processes draw problems [default: one a core]")
    ] = None,
) -> None:
    """Make demonstrations: draw training problems, solve them and write shards.

    The same command continues where it stopped.
    """
    require("train", "drpbench data")
    from drpbench.generation.training_problems import TRAINING_STREAM
    from drpbench.learning.demonstrations import Shards
    from drpbench.learning.production import fill

    _require_at_least(1, count=count, workers=workers)
    _require_at_least(0, first=first)
    shards = Shards(out, TRAINING_STREAM)
    from drpbench.compile import use_cache

    use_cache()
    from .terminal import DataProgress, console_of

    numbers = range(first, first + count)
    with DataProgress(console_of(), count) as progress:
        fill(shards, numbers, workers, progress.advance)
    counts = shards.counts
    typer.echo(
        f"{out}: {counts['drawn']} problems drawn, {counts['solved']} solved, "
        f"{counts['obstructed']} of them with the goal out of reach"
    )


def correct(
    weights: Annotated[
        str,
        typer.Argument(
            help=(
                "The file of weights; for a network of your own my_package.my_module:MyLearner:FILE"
            )
        ),
    ],
    demonstrations: Annotated[
        Path, typer.Option("--data", help="The folder that drpbench data wrote.")
    ],
    out: Annotated[Path, typer.Option(help="The folder to write to.")],
    count: Annotated[
        int | None,
        typer.Option(help="How many demonstrations to correct [default: all]"),
    ] = None,
    seed: Annotated[
        int, typer.Option(help="The seed of the point clouds and of the choice of corrections.")
    ] = 0,
) -> None:
    """Make corrections (DAgger): a network acts in demonstrated problems, and the expert plans on
    from where it drifts away.

    Then train with --data twice, for the demonstrations and for these. The same command continues
    where it stopped.
    """
    require("train", "drpbench correct")
    from drpbench.learning.corrections import fill_corrections
    from drpbench.learning.demonstrations import Shards, read
    from drpbench.plugins.networks import policy_of_file, split
    from drpbench.policies.weights import checksum

    there = read(demonstrations)
    count = there.count if count is None else count
    _require_at_least(1, count=count)
    if count > there.count:
        raise InputError(f"--count {count}: {demonstrations} holds {there.count} demonstrations")
    policy = policy_of_file(weights)
    shards = Shards(out, f"corrections-{checksum(split(weights)[1])[:8]}")
    from drpbench.compile import use_cache

    use_cache()
    from .terminal import DataProgress, console_of

    with DataProgress(console_of(), count, ("demonstrations", "corrections")) as progress:
        fill_corrections(shards, policy, there, count, seed, progress.advance)
    counts = shards.counts
    typer.echo(
        f"{out}: {counts['solved']} corrections after {counts['drawn']} demonstrations, "
        f"{counts['obstructed']} of them with the goal out of reach"
    )


def train(
    network: Annotated[
        str,
        typer.Argument(
            help="What to train: impact, neuralmp, or your own: my_package.my_module:MyLearner"
        ),
    ],
    out: Annotated[Path, typer.Option(help="The folder that the run writes to.")],
    demonstrations: Annotated[
        list[Path] | None,
        typer.Option(
            "--data",
            help=(
                "The folder that drpbench data or correct wrote; give it again for more "
                "[default: straight from the expert]"
            ),
        ),
    ] = None,
    size: Annotated[
        str | None,
        typer.Option(
            help="Of the network: full (the published) or small (for processors)"
            " [default: the network's first]"
        ),
    ] = None,
    steps: Annotated[
        int, typer.Option(help="How many steps to train; the paper has 1,000,000.")
    ] = 100_000,
    batch: Annotated[int, typer.Option(help="How many samples a step has.")] = 512,
    learning_rate: Annotated[
        float, typer.Option(help="The highest learning rate of the schedule.")
    ] = 1e-3,
    precision: Annotated[
        str | None,
        typer.Option(
            help="The network's precision: float32 or bfloat16 [default: bfloat16 on a GPU]"
        ),
    ] = None,
    seed: Annotated[
        int, typer.Option(help="The seed of the first weights and of the samples.")
    ] = 0,
    begun_from: Annotated[
        str,
        typer.Option(
            "--from", help="Begin from these weights: a shipped name, such as impact, or a file."
        ),
    ] = "",
    resume: Annotated[bool, typer.Option("--resume", help="Continue an unfinished run.")] = False,
    report_every: Annotated[
        int | None,
        typer.Option(
            help="How many steps lie between lines of the history "
            "[default: 100, or what divides the other numbers of steps]"
        ),
    ] = None,
    checkpoint_every: Annotated[
        int, typer.Option(help="How many steps lie between checkpoints.")
    ] = 1000,
    validate_every: Annotated[
        int, typer.Option(help="How many steps lie between validations; 0 means only at the end.")
    ] = 0,
    validation_problems: Annotated[
        int,
        typer.Option(
            help="How many episodes a validation has at home, and abroad; 0 means none.", min=0
        ),
    ] = 64,
    capacity: Annotated[
        int, typer.Option(help="How many demonstrations are kept at once, without --data.")
    ] = 65536,
    workers: Annotated[
        int | None, typer.Option(help="How many processes draw problems, without --data.")
    ] = None,
    tensorboard: Annotated[
        bool, typer.Option("--tensorboard", help="Write the history for TensorBoard too.")
    ] = False,
) -> None:
    """Train a network by behaviour cloning.

    The run's folder gets checkpoints, a history as CSV and as a plot, and the weights.
    """
    require("train", "drpbench train")
    _require_at_least(
        1,
        steps=steps,
        batch=batch,
        report_every=report_every,
        checkpoint_every=checkpoint_every,
        capacity=capacity,
        workers=workers,
    )
    _require_at_least(0, validate_every=validate_every)
    checkpoint_every = min(checkpoint_every, steps)
    if precision not in (None, "float32", "bfloat16"):
        raise InputError(f"--precision {precision}: expected float32 or bfloat16")
    from drpbench.compile import use_cache

    use_cache()
    from contextlib import AbstractContextManager, ExitStack, nullcontext

    import jax

    from drpbench.learning.cloning import CloningSettings
    from drpbench.learning.feed import Feed, Folder, Stream
    from drpbench.learning.history import Progress, TensorBoard
    from drpbench.learning.learners import learner
    from drpbench.learning.train import Run, reported_every
    from drpbench.learning.train import train as train_run

    from .terminal import TrainingProgress, console_of

    default = "float32" if jax.default_backend() == "cpu" else "bfloat16"
    settings = CloningSettings(
        steps=steps,
        batch=batch,
        learning_rate=learning_rate,
        precision=precision or default,
        seed=seed,
    )
    wanted = Run(
        out,
        learner(network, size),
        settings,
        resume,
        report_every=report_every or reported_every(steps, checkpoint_every, validate_every),
        checkpoint_every=checkpoint_every,
        validate_every=validate_every,
        validation_problems=validation_problems,
        begun_from=begun_from,
    )
    source: AbstractContextManager[Feed] = (
        nullcontext(Folder(*demonstrations))
        if demonstrations
        else Stream(capacity, workers=workers)
    )
    with ExitStack() as stack:
        # A run that is refused leaves nothing, and what it lacks is told before it begins.
        board = stack.enter_context(TensorBoard(out / "tensorboard")) if tensorboard else None
        feed = stack.enter_context(source)
        progress = stack.enter_context(TrainingProgress(console_of(), steps))

        def told(line: Progress, run: Run) -> None:
            progress.line(line, run)
            if board:
                board.add(line)

        train_run(wanted, feed, told)
    if not (out / "history.png").exists():
        typer.echo(
            f"{out / 'history.csv'} has no picture beside it, for matplotlib is not installed: "
            "pip install 'drpbench[train]'",
            err=True,
        )
    typer.echo(
        f"weights in {out / 'weights.safetensors'}; run them with --policy "
        f"{network}:{out}/weights.safetensors"
    )
