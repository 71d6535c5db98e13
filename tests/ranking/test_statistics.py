import math
import sys
import time
from fractions import Fraction

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.stats import binomtest

from drpbench.ranking import wilson
from drpbench.ranking.statistics import Paired, mcnemar, paired

counts = st.integers(1, 5000).flatmap(lambda n: st.tuples(st.integers(0, n), st.just(n)))


@settings(deadline=None)
@given(counts, st.sampled_from([0.5, 0.9, 0.95, 0.999]))
def test_wilson_agrees_with_scipy(count, confidence):
    k, n = count
    theirs = binomtest(k, n).proportion_ci(confidence, method="wilson")
    assert wilson(k, n, confidence) == pytest.approx((theirs.low, theirs.high), abs=1e-12)


@settings(deadline=None)
@given(counts)
def test_wilson_bounds_solve_the_score_equation(count):
    k, n = count
    z = 1.959963984540054
    for bound in wilson(k, n):
        # |k/n - p| = z sqrt(p (1 - p) / n), the definition the closed form comes from.
        assert abs(k / n - bound) == pytest.approx(z * math.sqrt(bound * (1 - bound) / n), abs=1e-9)


@settings(deadline=None)
@given(counts)
def test_wilson_holds_the_share_and_mirrors(count):
    k, n = count
    low, high = wilson(k, n)
    assert 0 <= low <= k / n <= high <= 1
    assert wilson(n - k, n) == pytest.approx((1 - high, 1 - low), abs=1e-12)


def test_wilson_of_a_known_case():
    assert wilson(151, 200) == pytest.approx((0.6910, 0.8094), abs=1e-4)


def test_wilson_is_exact_at_the_ends():
    assert wilson(0, 200)[0] == 0.0
    assert wilson(200, 200)[1] == 1.0
    assert wilson(0, 0) == (0.0, 1.0)


@pytest.mark.parametrize("arguments", [(3, 2), (-1, 2), (1, 2, 0.0), (1, 2, 1.0), (1, 2, 95)])
def test_wilson_refuses_what_is_no_proportion(arguments):
    with pytest.raises(ValueError, match="must lie"):
        wilson(*arguments)


@settings(deadline=None)
@given(st.integers(0, 300), st.integers(0, 300))
@example(10, 1065)
def test_mcnemar_is_the_exact_binomial_sum(b, c):
    n = b + c
    tail = sum(math.comb(n, i) for i in range(min(b, c) + 1))
    assert mcnemar(b, c) == pytest.approx(
        float(min(Fraction(1), Fraction(2 * tail, 2**n))), rel=1e-9, abs=0
    )
    assert mcnemar(b, c) == mcnemar(c, b)


@settings(deadline=None, max_examples=40)
@given(st.integers(0, 3000), st.integers(0, 3000))
def test_mcnemar_is_exact(b, c):
    # scipy's sum underflows from about 1e-299 on; whole numbers do not.
    n, term, total = b + c, 1, 1
    for i in range(min(b, c)):
        term = term * (n - i) // (i + 1)
        total += term
    exact = min(Fraction(1), Fraction(2 * total, 2**n))
    # Below the smallest normal float digits are lost.
    close = {"rel": 1e-9, "abs": 1e-9 * sys.float_info.min}
    assert mcnemar(b, c) == pytest.approx(float(exact), **close)


def test_mcnemar_of_known_cases():
    assert mcnemar(0, 0) == 1.0
    assert mcnemar(7, 7) == 1.0
    assert mcnemar(0, 5) == pytest.approx(2 / 32)
    assert mcnemar(1, 7) == pytest.approx(2 * 9 / 256)


def test_mcnemar_of_large_counts_is_right_and_fast():
    began = time.perf_counter()
    assert mcnemar(50_000, 51_000) == pytest.approx(binomtest(50_000, 101_000).pvalue, rel=1e-9)
    assert mcnemar(0, 100_000) == 0.0
    assert time.perf_counter() - began < 2


def test_mcnemar_refuses_negative_counts():
    with pytest.raises(ValueError, match="negative"):
        mcnemar(-1, 2)


def test_paired_counts_what_only_one_solves(make_result):
    first = make_result(verdicts={"FDO": "++++-x", "SE": "++"}).rows
    second = make_result(verdicts={"FDO": "+--x+-", "DGB": "-"}).rows
    assert paired(first, second) == Paired(3, 1, 6, mcnemar(3, 1))
    assert paired(second, first) == Paired(1, 3, 6, mcnemar(3, 1))


def test_paired_leaves_out_what_is_not_valid_in_both(make_row):
    first = [make_row(id=0), make_row(id=1, valid=False), make_row(id=2)]
    second = [make_row(id=i, reached=False, valid=i != 2) for i in range(3)]
    assert paired(first, second)[:3] == (1, 0, 1)


def test_paired_of_nothing_shared(make_result):
    first = make_result(verdicts={"FDO": "++"}).rows
    second = make_result(verdicts={"SE": "++"}).rows
    assert paired(first, second) == Paired(0, 0, 0, 1.0)
