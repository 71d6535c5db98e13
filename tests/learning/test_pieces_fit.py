"""A network that has learned a dozen problems by heart solves them in closed loop.

Everything between the expert and a result's rows is on the way: frames, units, clouds, the chunk's
timing, weights on disk, the policy, the world. Where two pieces disagree, it fails within minutes
instead of after days of training.
"""

import jax
import numpy as np
import pytest

from drpbench.evaluation import Request, run
from drpbench.evaluation.progress import Silent
from drpbench.geometry import stacked
from drpbench.learning import train as training
from drpbench.learning.cloning import CloningSettings
from drpbench.learning.learners.impact import ImpactLearner
from drpbench.learning.production import solve
from drpbench.learning.validation import problems
from drpbench.policies.networks.impact_size import ImpactSize
from drpbench.problems import ProblemSet, TaskProblems

from .tiny import Fixed

pytestmark = pytest.mark.slow

COUNT = 12
SLIM = ImpactSize(
    scene_points=128,
    scene_tokens=16,
    robot_points=32,
    robot_tokens=4,
    radius=0.2,
    samples=8,
    point_mlp=(16, 32),
    joint_mlp=(64, 64),
    width=64,
    feed_forward=128,
    heads=4,
    encoder_layers=1,
    decoder_layers=1,
)


@pytest.fixture(scope="module")
def solved(drawn):
    found = solve(drawn)
    kept = np.nonzero(np.asarray(found.reached))[0][:COUNT]
    by_number = {one.index: one for one in drawn}
    return (
        jax.tree.map(lambda leaf: np.asarray(leaf)[kept], found),
        [by_number[int(number)] for number in np.asarray(found.index)[kept]],
    )


def as_set(drawn):
    """The problems as a set that `drpbench run` takes."""
    batch = problems(drawn)
    static = TaskProblems(
        task="SE",
        obstacles=stacked([one.obstacles for one in drawn]),
        start=batch.start,
        goal=batch.goal,
        goal_position=batch.goal_position,
        goal_quaternion=batch.goal_quaternion,
        family=["any"] * len(drawn),
        pair=["any"] * len(drawn),
        level=np.zeros(len(drawn), np.int32),
        witness=[one.hint for one in drawn],
    )
    return ProblemSet("by-heart", "0" * 64, {"SE": static})


def test_what_was_learned_by_heart_is_solved_in_closed_loop(solved, tmp_path):
    demonstrations, drawn = solved
    assert len(drawn) == COUNT
    settings = CloningSettings(steps=700, batch=96, learning_rate=2e-3, averaging=0.99)
    wanted = training.Run(
        tmp_path / "run",
        ImpactLearner(SLIM),
        settings,
        report_every=350,
        checkpoint_every=700,
        validation_problems=0,
    )
    training.train(wanted, Fixed(demonstrations), lambda line, run: None)
    request = Request(
        policy=f"impact:{tmp_path / 'run' / 'weights.safetensors'}",
        problems={"SE": None},
        out=tmp_path / "by-heart.json",
        problem_set=as_set(drawn),
    )
    rows = run(request, Silent()).rows
    assert len(rows) == COUNT
    assert sum(row.success for row in rows) >= 10, [
        (row.id, row.collided, row.position_error) for row in rows
    ]
