"""The episode's clock."""

import math

import pytest

from drpbench.contract import EPISODE, Episode


def test_the_benchmarks_episode_is_the_protocols():
    assert Episode() == EPISODE and EPISODE.pace == 1.0
    assert EPISODE.duration == pytest.approx(1000 / 60)
    assert [EPISODE.lasting(steps) for steps in (1, 5, 30, 300)] == [1, 5, 30, 300]


@pytest.mark.parametrize("rate", [20, 30, 50, 120, 500])
def test_times_and_speeds_stay_what_they_are_at_another_rate(rate):
    episode = Episode(steps=10 * rate, period=1 / rate)
    assert episode.duration == pytest.approx(10.0)
    for steps in (30, 100, 300):
        assert episode.lasting(steps) * episode.period == pytest.approx(
            steps / 60, abs=episode.period
        )
    assert 0.001 * episode.pace / episode.period == pytest.approx(0.06)  # [m/s]


def test_an_event_lasts_a_step_at_least():
    assert Episode(period=1.0).lasting(5) == 1


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"steps": 0}, "at least 1 control step, got 0"),
        ({"period": 0.0}, "positive number of seconds, got 0.0"),
        ({"period": math.inf}, "positive number of seconds, got inf"),
    ],
)
def test_an_episode_that_is_none_is_refused(wrong, said):
    with pytest.raises(ValueError, match=said):
        Episode(**wrong)


def test_episodes_are_values():
    assert len({Episode(), Episode(1000, 1 / 60), Episode(100)}) == 2
