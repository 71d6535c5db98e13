"""A public score against one on sealed problems."""

import pytest

from drpbench.ranking import LeaderboardError
from drpbench.ranking.sealed import differences
from drpbench.ranking.statistics import newcombe


def test_newcombes_interval_is_the_published_one():
    # R. G. Newcombe (1998), table II, method 10: 56/70 against 48/80, and 10/10 against 0/20.
    assert newcombe(56, 70, 48, 80) == pytest.approx((0.0524, 0.3339), abs=5e-5)
    assert newcombe(10, 10, 0, 20) == pytest.approx((0.6791, 1.0), abs=5e-5)
    with pytest.raises(ValueError, match="expected trials on both sides"):
        newcombe(0, 0, 1, 2)


def test_the_difference_is_told_by_task(make_result):
    public = make_result("mine", {"FDO": "++++++++--", "SE": "+-"})
    sealed = make_result("mine", {"FDO": "++++------"}, problem_set="sealed-1")
    lines = differences({"a.json": public, "b.json": sealed})
    assert lines[0] == "mine: drpbench-v1 minus sealed-1"
    assert lines[1].startswith("  FDO: 8/10 (80.0 %) minus 4/10 (40.0 %) = +40.0 points [")
    assert len(lines) == 2


def test_what_cannot_be_compared_is_said(make_result):
    mine = make_result("mine", {"FDO": "+"})
    for other, told in (
        (make_result("yours", {"FDO": "+"}), "one policy, got mine and yours"),
        (make_result("mine", {"SE": "+"}), "a task in common"),
        (make_result("mine", {"FDO": "+"}, protocol=2), "one protocol, got 1 and 2"),
    ):
        with pytest.raises(LeaderboardError, match=told):
            differences({"a": mine, "b": other})
