"""SE: nothing moves."""

import numpy as np


def test_there_are_no_moving_boxes(lives):
    born, last, (position, _, active), valid = lives("SE")
    assert born.count == last.count == 0
    assert position.shape == (200, 1000, 0, 3) and active.shape == (200, 1000, 0)
    assert np.asarray(valid).all()
