"""Two runs on the same problems, problem by problem."""

import pytest

from drpbench.ranking import LeaderboardError
from drpbench.ranking.compare import compared


def test_what_turned_is_listed_with_its_recordings(make_result, tmp_path):
    (tmp_path / "a").mkdir()
    (tmp_path / "a" / "FDO-00001.mcap").touch()
    results = {
        str(tmp_path / "a.json"): make_result("mine", {"FDO": "++x-"}),
        str(tmp_path / "b.json"): make_result("mine", {"FDO": "+-+-"}, name="second"),
    }
    lines = compared(results, 20)
    assert lines[1].endswith("b.json (second)")
    assert lines[2].startswith("FDO: both 1, A alone 1, B alone 1, neither 1, of 4; A minus B +0.0")
    assert lines[3] == "  FDO 1 (box): A solves it, B does not reach it"
    assert lines[4] == f"    {tmp_path}/a/FDO-00001.mcap"
    assert lines[5] == "  FDO 2 (box): A touches with hand at step 30, B solves it"
    assert compared(results, 1)[-1] == "  and 1 more"


def test_what_cannot_be_compared_is_said(make_result):
    a = make_result("mine", {"FDO": "+"})
    for other, told in (
        (make_result("mine", {"SE": "+"}), "a problem in common"),
        (make_result("mine", {"FDO": "+"}, seed=3), "one seed, got 0 and 3"),
        (make_result("mine", {"FDO": "+"}, protocol=2), "one protocol"),
    ):
        with pytest.raises(LeaderboardError, match=told):
            compared({"a": a, "b": other}, 5)
