"""A public score against a sealed one: independent problems, so no pairs."""

from __future__ import annotations

from collections.abc import Mapping

from drpbench.results import Result

from .board import LeaderboardError, require_same
from .measures import percent
from .statistics import newcombe


def differences(results: Mapping[str, Result]) -> list[str]:
    """Lines on two results: of each task that both have, the rates and their difference.

    Raises LeaderboardError where they are of two protocols or policies, or share no task.
    """
    (first, a), (second, b) = results.items()
    require_same(results, ("protocol", "policy"))
    counts = [
        {
            task: [row.success for row in result.rows if row.task == task and row.valid]
            for task in result.header.tasks
        }
        for result in (a, b)
    ]
    shared = [task for task in counts[0] if counts[0][task] and counts[1].get(task)]
    if not shared:
        raise LeaderboardError(f"{first} and {second}: expected a task in common, got none")
    lines = [f"{a.header.policy}: {a.header.problem_set} minus {b.header.problem_set}"]
    for task in shared:
        one, two = counts[0][task], counts[1][task]
        k, n, other_k, other_n = sum(one), len(one), sum(two), len(two)
        low, high = newcombe(k, n, other_k, other_n)
        lines.append(
            f"  {task}: {k}/{n} ({percent(k / n)} %) minus {other_k}/{other_n} "
            f"({percent(other_k / other_n)} %) = {100 * (k / n - other_k / other_n):+.1f} points "
            f"[{100 * low:+.1f}, {100 * high:+.1f}]"
        )
    return lines
