"""One short rollout that every test of this room looks at."""

from types import SimpleNamespace

import pytest

from drpbench.contract import PROTOCOL
from drpbench.envs import TASKS, World
from drpbench.evaluation.machine import versions
from drpbench.evaluation.metrics import rows
from drpbench.plugins.registry import parameters
from drpbench.policies import DcpRmp, Straight
from drpbench.problems import load_set
from drpbench.recording import traced
from drpbench.results import Header, Result
from drpbench.results.trajectories import Trajectories
from drpbench.rollout import Rollout

IDS = [3, 17, 150]
SEED = 5


@pytest.fixture(scope="session")
def rolled():
    """The blind straight line under DCP-RMP on three problems of FDO: ids, trace, rows,
    episodes."""
    policy, problems = DcpRmp(Straight()), load_set().task("FDO")
    trace = Rollout(World(TASKS["FDO"]), policy, SEED, lanes=len(IDS)).run(problems.take(IDS))
    return SimpleNamespace(
        ids=IDS,
        seed=SEED,
        trace=trace,
        policy=policy,
        problems=problems,
        rows=rows(IDS, [problems.family[i] for i in IDS], trace),
        episodes=[traced(id, problems, SEED, trace, b) for b, id in enumerate(IDS)],
    )


@pytest.fixture(scope="session")
def header(rolled):
    """The header of a run that made these."""
    fields = {
        "protocol": PROTOCOL,
        "policy": "straight+dcp-rmp",
        "policy_parameters": parameters(rolled.policy),
        "privileged": False,
        "tasks": ["FDO"],
        "problem_set": load_set().name,
        "problem_set_sha256": load_set().sha256,
        "seed": rolled.seed,
        "precision": "float32",
        "device": "a processor",
        "batch_size": 64,
        "versions": versions(),
        "platform": "Linux",
        "created": "2025-01-01T00:00:00+00:00",
        "problems": {"FDO": rolled.ids},
        "wall_seconds": 0.0,
    }
    return Header(**fields)


@pytest.fixture
def stored(rolled, header, tmp_path):
    """The same as a result and its trajectories: the result, and the path of its file."""
    path = tmp_path / "run.json"
    trajectories = Trajectories(path)
    trajectories.add("FDO", rolled.ids, rolled.trace)
    trajectories.finish()
    return Result(header=header, rows=rolled.rows), path
