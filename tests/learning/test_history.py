"""A history as an event file, and how often there is a line of it."""

import pytest

from drpbench.learning.history import Progress, TensorBoard
from drpbench.learning.train import reported_every


def line(step, **scores):
    return Progress(step, 10 * step, 1.0, 0.5, 1e-3, 100.0, **scores)


def test_an_event_file_has_the_losses_and_the_rates_of_validations(tmp_path):
    pytest.importorskip("tensorboardX")
    with TensorBoard(tmp_path / "events") as board:
        assert not (tmp_path / "events").exists()  # nothing is left of a run that never began
        board.add(line(1))
        board.add(line(2, validated=4, reached=3, succeeded=2))
    (file,) = (tmp_path / "events").iterdir()
    content = file.read_bytes()
    assert content.count(b"loss") == 2 and content.count(b"validation/succeeded") == 1
    assert b"abroad" not in content


@pytest.mark.parametrize(
    ("periods", "every"),
    [((20, 20, 0), 20), ((100_000, 1000, 0), 100), ((150, 150, 0), 75), ((7, 7, 0), 7)],
)
def test_lines_of_the_history_divide_what_is_asked_for(periods, every):
    assert reported_every(*periods) == every
