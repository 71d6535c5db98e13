"""What the DRP paper reports for its own DRPBench, in its own simulator on its own problems.

Copied digit by digit from the success table and the reach/collision table of "Deep Reactive
Policy: Learning Reactive Manipulator Motion Planning for Dynamic Environments". The paper's
evaluation ran in Isaac Gym on problems that were never published, so these figures stand beneath
a leaderboard for orientation and are never computed with.
"""

from __future__ import annotations

from dataclasses import dataclass

REPORTED_TASKS = ("SE", "SAO", "FDO", "GB", "DGB")

REPORTED_NOTE = (
    "Reported elsewhere: other simulator, other problems; not comparable digit by digit."
)


@dataclass(frozen=True)
class Reported:
    """A row of the paper's tables.

    Attributes:
        method: the paper's name for it.
        success: success [%] per task, in the order of REPORTED_TASKS.
        reach: goal-reaching rate [%] per task, None where the paper gives none.
        collision: collision rate [%] per task, None where the paper gives none.
        privileged: whether it was given the obstacle models.
    """

    method: str
    success: tuple[float, ...]
    reach: tuple[float | None, ...] = (None,) * 5
    collision: tuple[float | None, ...] = (None,) * 5
    privileged: bool = False


REPORTED = (
    Reported(
        "AIT*",
        (40.50, 0, 0, 0, 0),
        (60.81, None, None, None, None),
        (20.31, None, None, None, None),
        privileged=True,
    ),
    Reported(
        "cuRobo",
        (82.97, 59.00, 39.50, 0, 3.00),
        (91.71, 94.00, 93.00, 0.00, 91.33),
        # Printed "36/33" for SAO; read as 36.33, which is 109 of 300.
        (10.66, 36.33, 60.00, 23.46, 96.75),
        privileged=True,
    ),
    Reported(
        "cuRobo-Vox",
        (50.53, 58.67, 40.50, 0, 2.50),
        (79.25, 96.00, 96.50, 0.00, 91.50),
        (45.35, 38.67, 59.00, 21.25, 97.25),
    ),
    Reported(
        "RMP",
        (32.97, 46.00, 49.50, 71.08, 50.50),
        (38.69, 54.33, 55.50, 88.19, 54.00),
        (49.88, 35.00, 21.00, 22.77, 24.00),
    ),
    Reported(
        "MPiNets",
        (2.50, 0.33, 0, 0, 0),
        (3.25, 0.67, 1.00, 2.21, 1.75),
        (46.56, 47.00, 68.00, 71.15, 95.25),
    ),
    Reported(
        "MPiFormer",
        (0.19, 0, 0, 0, 0),
        (0.41, 0.00, 0.00, 0.00, 0.25),
        (56.72, 44.00, 53.00, 23.28, 58.00),
    ),
    Reported(
        "NeuralMP",
        (50.59, 33.16, 19.00, 0, 0.25),
        (81.97, 86.33, 97.00, 97.94, 92.75),
        (49.06, 44.33, 80.50, 100.00, 99.50),
    ),
    Reported("IMPACT (no finetune)", (58.25, 47.33, 13.50, 46.50, 0)),
    Reported(
        "IMPACT",
        (84.60, 86.00, 32.00, 66.67, 0.25),
        (91.34, 95.67, 97.00, 95.00, 95.00),
        (10.16, 12.33, 67.50, 31.64, 99.25),
    ),
    Reported(
        "DRP",
        (84.60, 86.00, 75.50, 66.67, 65.25),
        (91.34, 95.67, 96.00, 95.00, 95.50),
        (10.16, 12.33, 23.00, 31.64, 32.75),
    ),
)


def method(reported: Reported) -> str:
    """Its name, marked where it is privileged."""
    return reported.method + ("†" if reported.privileged else "")


def reported_rates(reported: Reported) -> list[str]:
    """Of each task `reach/collision`, as reported; a dash where they are not."""
    return [
        "–" if reach is None or collision is None else f"{reach:.2f}/{collision:.2f}"
        for reach, collision in zip(reported.reach, reported.collision, strict=True)
    ]
