"""Episodes of a result come back as they were, or it is said how they differ."""

import numpy as np
import pytest

from drpbench.evaluation.results import Result
from drpbench.recording import RecordingError, Replayer


def test_recorded_trajectories_are_taken_as_they_are(stored, rolled):
    result, path = stored
    replayer = Replayer(result, path, advanced=lambda steps: pytest.fail("nothing is run again"))
    rows = [replayer.row(None, 150), replayer.row("FDO", 3)]
    found = replayer.replay(rows)
    assert [replay.episode.id for replay in found] == [150, 3]
    for replay, b in zip(found, (2, 0), strict=True):
        assert replay.remark is None
        np.testing.assert_array_equal(
            replay.episode.joint_position[1:], rolled.trace.joint_position[:, b]
        )


@pytest.mark.parametrize(
    ("task", "id", "said"),
    [(None, 4, "no FDO 4; it has 3, 17, 150"), ("SE", 3, "no SE; it has: FDO")],
)
def test_what_the_result_does_not_have_is_refused(stored, task, id, said):
    with pytest.raises(RecordingError, match=said):
        Replayer(*stored).row(task, id)


def test_another_runs_trajectories_are_refused(stored):
    result, path = stored
    rows = [
        row.model_copy(update={"position_error": row.position_error + 0.1}) for row in result.rows
    ]
    wrong = Result.model_construct(header=result.header, rows=rows)
    with pytest.raises(RecordingError, match="does not belong to this result: FDO 17 ends"):
        replayer = Replayer(wrong, path)
        replayer.replay([replayer.row("FDO", 17)])


def test_another_verdict_is_refused(stored):
    result, path = stored
    row = next(row for row in result.rows if row.collided)
    changed = row.model_copy(update={"collided": False})
    with pytest.raises(RecordingError, match="collides there and not in the row"):
        Replayer(result, path).replay([changed])


def test_other_problems_are_refused(stored):
    result, path = stored
    header = result.header.model_copy(update={"problem_set_sha256": "0" * 64})
    with pytest.raises(RecordingError, match="run it again"):
        Replayer(result.model_copy(update={"header": header}), path)


def test_a_truncated_npz_is_refused(stored):
    result, path = stored
    npz = path.with_suffix(".npz")
    npz.write_bytes(npz.read_bytes()[:1000])
    replayer = Replayer(result, path)
    with pytest.raises(RecordingError, match="not a readable trajectory file"):
        replayer.replay([replayer.row("FDO", 3)])
