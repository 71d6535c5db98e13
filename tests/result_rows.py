"""Headers, rows and results to vary: a test names only what it cares about."""

from drpbench.results import Header, Result, Row
from drpbench.results.schema import VERSIONED


def header(policy="rmp", tasks=("FDO",), **changes):
    fields = {
        "policy": policy,
        "policy_parameters": {"gain": 100.0, "levels": [1, 2]},
        "privileged": False,
        "tasks": list(tasks),
        "problem_set": "drpbench-v1",
        "problem_set_sha256": "a" * 64,
        "seed": 0,
        "precision": "float32",
        "device": "cpu",
        "batch_size": 64,
        "versions": dict.fromkeys(VERSIONED, "1.0"),
        "platform": "Linux",
        "created": "2025-01-01T00:00:00+00:00",
        "problems": dict.fromkeys(tasks),
        "wall_seconds": 0.0,
    }
    return Header(**(fields | changes))


def row(task="FDO", id=0, reached=True, collided=False, **changes):
    fields = {
        "id": id,
        "task": task,
        "family": "box",
        "success": reached and not collided,
        "reached": reached,
        "reached_5cm": reached,
        "reached_once": reached,
        "collided": collided,
        "first_collision_step": 30 if collided else None,
        "first_collision_link": "hand" if collided else None,
        "self_collided": False,
        "min_clearance": -0.001 if collided else 0.02,
        "position_error": 0.004 if reached else 0.3,
        "orientation_error": 0.1,
        "time_to_goal": 4.5 if reached else None,
        "joint_path_length": 6.0,
        "ee_path_length": 1.5,
        "sparc_joint": -2.5,
        "sparc_ee": -2.0,
        "joint_limit_violation": False,
    }
    return Row(**(fields | changes))


def result(policy, rows, **changes):
    """Of the tasks that the rows are of."""
    tasks = tuple(dict.fromkeys(row.task for row in rows))
    return Result(header=header(policy, tasks, **changes), rows=rows)
