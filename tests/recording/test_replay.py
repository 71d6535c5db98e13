"""Episodes of a result come back as they were, or it is said how they differ."""

from dataclasses import fields
from types import SimpleNamespace

import numpy as np
import pytest

from drpbench.evaluation import rerun
from drpbench.recording import RecordingError, Replayer
from drpbench.results import Result, ResultsError


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
        row.model_copy(update={"position_error": row.position_error + 0.002}) for row in result.rows
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
    with pytest.raises(ResultsError, match="with checksum 0{12}.*; the problems here are"):
        Replayer(result.model_copy(update={"header": header}), path)


def test_a_row_of_a_problem_that_there_is_not_is_refused(stored):
    result, path = stored
    header = result.header.model_copy(update={"problems": {"FDO": None}})
    rows = [row.model_copy(update={"id": 9999}) for row in result.rows[:1]]
    with pytest.raises(ResultsError, match="FDO 9999: there is no such problem"):
        Replayer(Result.model_construct(header=header, rows=rows), path)


def test_a_truncated_npz_is_refused(stored):
    result, path = stored
    npz = path.with_suffix(".npz")
    npz.write_bytes(npz.read_bytes()[:1000])
    replayer = Replayer(result, path)
    with pytest.raises(RecordingError, match="not a readable trajectory file"):
        replayer.replay([replayer.row("FDO", 3)])


@pytest.fixture
def again(rolled, header, monkeypatch):
    """Running again, as if it came out as it did here; what it was asked for."""
    asked = []

    def run(request, progress):
        asked.append(request)
        (ids,) = request.problems.values()
        progress.advance(1000)
        lanes = [rolled.ids.index(id) for id in ids]
        assert lanes == list(range(len(lanes))) or len(lanes) == 1
        parts = {
            field.name: getattr(rolled.trace, field.name) for field in fields(type(rolled.trace))
        }
        trace = SimpleNamespace(
            world=rolled.trace.world,
            **{
                name: value[lanes] if name in ("start", "start_grip", "valid") else value[:, lanes]
                for name, value in parts.items()
                if isinstance(value, np.ndarray)
            },
        )
        choice = rerun.choose(request.policy, request.policy_arguments)
        parameters = {"policy_parameters": choice.parameters, "seed": request.seed}
        now = header.model_copy(update=parameters)
        request.watch(now, "FDO", ids, trace)
        return SimpleNamespace(header=now, rows=[rolled.rows[lane] for lane in lanes])

    monkeypatch.setattr(rerun, "run", run)
    return asked


def test_without_trajectories_the_episode_is_run_again(stored, rolled, again):
    result, path = stored
    path.with_suffix(".npz").unlink()
    told = []
    replayer = Replayer(result, path, told.append)
    (found,) = replayer.replay([replayer.row("FDO", 17)])
    assert told == [1000] and found.remark is None
    assert (again[0].seed, again[0].policy) == (rolled.seed, "straight+dcp-rmp")
    np.testing.assert_array_equal(
        found.episode.joint_position[1:], rolled.trace.joint_position[:, 1]
    )


def test_another_outcome_is_told_with_what_has_changed(stored, rolled, again):
    result, path = stored
    path.with_suffix(".npz").unlink()
    row = next(row for row in result.rows if row.collided)
    then = row.model_copy(update={"first_collision_step": 999})
    header = result.header.model_copy(
        update={"versions": {**result.header.versions, "jax": "0.9.0"}}
    )
    replayer = Replayer(result.model_copy(update={"header": header}), path)
    (found,) = replayer.replay([then])
    for part in (
        "step 999",
        f"step {row.first_collision_step}",
        "jax 0.9.0 then",
        "a processor then",
    ):
        assert part in found.remark
    assert len(found.remark.splitlines()) == 1


def _stating(stored, **parameters):
    """The replayer of a result whose header states these parameters, without trajectories."""
    result, path = stored
    path.with_suffix(".npz").unlink()
    stated = {**result.header.policy_parameters, **parameters}
    header = result.header.model_copy(update={"policy_parameters": stated})
    return Replayer(result.model_copy(update={"header": header}), path)


def test_a_policy_is_run_again_with_the_parameters_it_was_given(stored, again):
    replayer = _stating(stored, **{"policy.speed": 0.25})
    replayer.replay([replayer.row("FDO", 3)])
    assert list(again[0].policy_arguments) == ["speed=0.25"]


def test_a_policy_with_parameters_that_cannot_be_given_is_not_run_again(stored, again):
    replayer = _stating(stored, **{"constants.k_p": 7.0})
    with pytest.raises(ResultsError, match=r"constants.k_p 7.0, and is 100.0 here") as error:
        replayer.replay([replayer.row("FDO", 3)])
    assert not again and len(str(error.value).splitlines()) == 1


def test_a_grid_is_spread_over_the_result(stored):
    replayer = Replayer(*stored)
    assert [row.id for row in replayer.spread("FDO", 3)] == [3, 17, 150]
    assert [row.id for row in replayer.spread(None, 1)] == [3]
    with pytest.raises(RecordingError, match="--grid 4: the result has 1 to 3"):
        replayer.spread("FDO", 4)
