"""docs/environments.md: the functions' snippet runs as it stands. (The other one:
test_vector.py.)"""

import numpy as np
import pytest

from .snippets import snippet

pytestmark = pytest.mark.slow


def test_the_functions_snippet_runs():
    names = snippet("drpbench.envs")
    assert names["events"].clearance.shape == (30, 8)
    assert names["collided"].shape == (8,)
    moved = np.abs(names["states"].joint_position - names["problems"].start).max(axis=1)
    assert (moved > 0.05).all()


def test_problems_to_learn_from_are_drawn_as_the_page_says():
    names = snippet("drpbench.generation.training_problems")
    assert 1 <= len(names["problems"].id) <= 8 and names["problems"].start.shape[1] == 7
