"""drpbench: does a manipulator policy survive a moving world?

The names below are imported at their first use, so that importing the package takes no time and
starts no backend.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from drpbench.contract import EPISODE as EPISODE
    from drpbench.contract import Episode as Episode
    from drpbench.contract import HostPolicy as HostPolicy
    from drpbench.contract import Observation as Observation
    from drpbench.contract import Policy as Policy
    from drpbench.contract import Problem as Problem
    from drpbench.contract import Sensor as Sensor
    from drpbench.envs import TASKS as TASKS
    from drpbench.envs import World as World
    from drpbench.errors import DrpbenchError as DrpbenchError
    from drpbench.evaluation.evaluate import Evaluation as Evaluation
    from drpbench.evaluation.evaluate import evaluate as evaluate
    from drpbench.evaluation.evaluate import leaderboard as leaderboard
    from drpbench.perception import SurfaceCloud as SurfaceCloud
    from drpbench.problems import ProblemSet as ProblemSet
    from drpbench.problems import load_set as load_problems  # noqa: F401
    from drpbench.robot import PANDA as PANDA
    from drpbench.robot import Robot as Robot
    from drpbench.rollout import Rollout as Rollout

__version__ = "0.1.0"

_HOMES = {
    "EPISODE": "contract",
    "Episode": "contract",
    "HostPolicy": "contract",
    "Observation": "contract",
    "Policy": "contract",
    "Problem": "contract",
    "Sensor": "contract",
    "TASKS": "envs",
    "World": "envs",
    "DrpbenchError": "errors",
    "Evaluation": "evaluation.evaluate",
    "evaluate": "evaluation.evaluate",
    "leaderboard": "evaluation.evaluate",
    "SurfaceCloud": "perception",
    "ProblemSet": "problems",
    "load_problems": "problems",
    "PANDA": "robot",
    "Robot": "robot",
    "Rollout": "rollout",
}
_NAMED = {"load_problems": "load_set"}  # where it has another name at home

__all__ = ["__version__", *_HOMES]


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'drpbench' has no attribute {name!r}")
    value = getattr(importlib.import_module(f"drpbench.{_HOMES[name]}"), _NAMED.get(name, name))
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *_HOMES})
