"""Success where contacts of some depth are allowed."""

import numpy as np

from drpbench.envs.contact import STIFFNESS
from drpbench.ranking.depth import LIGHT_DEPTH, successes_by_depth

from ..result_rows import row


def test_a_light_contact_is_one_of_1_newton():
    np.testing.assert_allclose(LIGHT_DEPTH * STIFFNESS, 1.0)


def test_what_touched_deeper_or_did_not_arrive_is_no_success():
    rows = [
        row(id=0, min_clearance=0.01),
        row(id=1, collided=True, min_clearance=-4e-5),
        row(id=2, collided=True, min_clearance=-1e-3),
        row(id=3, reached=False, collided=True, min_clearance=-1e-6),
        row(id=4, min_clearance=None),
    ]
    assert successes_by_depth(rows, [0.0, LIGHT_DEPTH, 9.9e-4, 1e-3, 1.0]).tolist() == [
        2,
        3,
        3,
        4,
        4,
    ]
    assert successes_by_depth(rows, [0.0])[0] == sum(row.success for row in rows)
    assert not successes_by_depth([], np.ones(3)).any()
