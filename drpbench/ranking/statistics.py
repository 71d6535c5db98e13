"""The two statistics of the leaderboard: an interval for a rate, a test for a difference.

Both need nothing but the standard library.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from statistics import NormalDist
from typing import NamedTuple

from drpbench.results import Row


def wilson(k: int, n: int, confidence: float = 0.95) -> tuple[float, float]:
    r"""Wilson's score interval for a binomial proportion.

    .. math:: \frac{p + z^2/2n \pm z \sqrt{p(1-p)/n + z^2/4n^2}}{1 + z^2/n}, \quad p = k/n

    Unlike the textbook interval it stays within [0, 1] and has a width at k = 0 and k = n.

    Args:
        k: successes.
        n: trials; none at all leave the rate anywhere in (0, 1).
        confidence: two-sided coverage, above 0 and below 1.

    Returns:
        The bounds of the proportion, 0 <= low <= k/n <= high <= 1.

    Raises:
        ValueError: k is not within 0..n, or the confidence not within (0, 1).

    Source: E. B. Wilson, Journal of the American Statistical Association 22 (1927).
    """
    if not 0 <= k <= n:
        raise ValueError(f"k must lie within 0..n, got k = {k}, n = {n}")
    if not 0 < confidence < 1:
        raise ValueError(f"confidence must lie between 0 and 1, got {confidence}")
    if n == 0:
        return 0.0, 1.0
    z = NormalDist().inv_cdf((1 + confidence) / 2)
    p = k / n
    centre = p + z * z / (2 * n)
    half = z * math.sqrt(p * (1 - p) / n + z * z / (4 * n * n))
    scale = 1 + z * z / n
    # At k = 0 and k = n a bound is exact, where the formula leaves its rounding error.
    low = 0.0 if k == 0 else max(0.0, (centre - half) / scale)
    high = 1.0 if k == n else min(1.0, (centre + half) / scale)
    return low, high


def newcombe(k: int, n: int, other_k: int, other_n: int) -> tuple[float, float]:
    r"""Newcombe's 95 % interval for the difference of two independent proportions.

    With p = k/n, its Wilson bounds l and u, and the same of the other,

    .. math:: p - p' - \sqrt{(p - l)^2 + (u' - p')^2} \;\ldots\;
              p - p' + \sqrt{(u - p)^2 + (p' - l')^2}

    Returns:
        The bounds of p - p', within [-1, 1].

    Raises:
        ValueError: a count is out of its range, or there is no trial.

    Source: R. G. Newcombe, Statistics in Medicine 17 (1998), method 10.
    """
    if not n or not other_n:
        raise ValueError(f"expected trials on both sides, got {n} and {other_n}")
    p, other = k / n, other_k / other_n
    low, high = wilson(k, n)
    other_low, other_high = wilson(other_k, other_n)
    return (
        p - other - math.hypot(p - low, other_high - other),
        p - other + math.hypot(high - p, other - other_low),
    )


def mcnemar(b: int, c: int) -> float:
    r"""McNemar's exact test: do two policies differ on the instances where only one succeeds?

    If they don't, each of the :math:`n = b + c` discordant instances is a fair coin, so

    .. math:: p = \min\Bigl(1,\; 2 \cdot 2^{-n} \sum_{i=0}^{\min(b,c)} \binom{n}{i}\Bigr).

    Args:
        b: instances where only the first succeeds.
        c: instances where only the second succeeds.

    Returns:
        The two-sided p-value; 1 where there is no discordant instance.

    Raises:
        ValueError: a count is negative.

    Source: Q. McNemar, Psychometrika 12 (1947), in its exact binomial form.
    """
    if b < 0 or c < 0:
        raise ValueError(f"counts cannot be negative, got {b} and {c}")
    n, fewer = b + c, min(b, c)
    if b == c:
        return 1.0
    # From the largest term down, each the one above times i / (n - i + 1), until none counts:
    # the division of integers is exact, so is every figure of the sum, however large n is.
    total = term = 1.0
    for i in range(fewer, 0, -1):
        term *= i / (n - i + 1)
        total += term
        if term < 1e-17 * total:
            break
    return min(1.0, 2 * (math.comb(n, fewer) / (1 << n)) * total)


class Paired(NamedTuple):
    """Two policies on the instances both were run on."""

    only_first: int
    """Instances where only the first succeeded (McNemar's b)."""
    only_second: int
    """Instances where only the second succeeded (McNemar's c)."""
    shared: int
    """Instances compared."""
    p: float
    """McNemar's exact two-sided p-value."""

    @property
    def difference(self) -> tuple[float, float, float]:
        """The first's success rate minus the second's, and its 95 % bounds.

        The bounds are Wald's after a half is added to each of the four counts of pairs (A. Agresti
        and Y. Min, Statistics in Medicine 24 (2005)), cut off at -1 and 1.
        """
        b, c, n = self.only_first + 0.5, self.only_second + 0.5, self.shared + 2
        z, centre = NormalDist().inv_cdf(0.975), (b - c) / n
        half = z * math.sqrt(b + c - (b - c) ** 2 / n) / n
        told = (self.only_first - self.only_second) / self.shared if self.shared else 0.0
        return told, max(-1.0, centre - half), min(1.0, centre + half)


def paired(first: Iterable[Row], second: Iterable[Row]) -> Paired:
    """Compares two policies' success on the (task, id) that are valid in both."""
    by_key = {row.key: row.success for row in second if row.valid}
    pairs = [(row.success, by_key[row.key]) for row in first if row.valid and row.key in by_key]
    b = sum(1 for one, other in pairs if one and not other)
    c = sum(1 for one, other in pairs if other and not one)
    return Paired(b, c, len(pairs), mcnemar(b, c))
