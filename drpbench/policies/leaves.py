"""The obstacle leaf of a Riemannian motion policy: an acceleration of a distance, with a metric.

For a distance x of any kind [u], its rate xd [u/s], and gains in units of u,

    f = k_p exp(-x / l_p) - k_v s xd / (x / l_d + eps_d)       s  1 when closing, 0 when opening
    m = s g mu_r / (x / l_m + eps_m)                           g  1 at contact, 0 from x = r on

`rmp` has one leaf for each link, in metres; DCP-RMP has one, in squared metres. The switch s and
the gate g come from the caller: DCP-RMP writes them as the paper does, 1 - 1 / (1 + exp(-xd / l_v))
and (x - r)^2 / r^2, `rmp` as sigmoid(-xd / l_v) and (1 - x / r)^2. The signs of xd and the curves
agree, but the last digits do not, and the shipped results were made with each policy's own.
"""

from typing import Protocol, runtime_checkable

import jax.numpy as jnp
from jaxtyping import Array, Float

from drpbench.contract import Scalar


@runtime_checkable
class LeafGains(Protocol):
    """The leaf's constants, for x in the unit u."""

    @property
    def k_p(self) -> Scalar:
        """Push at contact [u/s^2]."""
        ...

    @property
    def l_p(self) -> Scalar:
        """How far the push reaches [u]."""
        ...

    @property
    def k_v(self) -> Scalar:
        """Damping of the approach [1/s]."""
        ...

    @property
    def l_d(self) -> Scalar:
        """How far the damping reaches [u]."""
        ...

    @property
    def eps_d(self) -> Scalar:
        """Bounds the damping at contact."""
        ...

    @property
    def mu_r(self) -> Scalar:
        """Weight against the other leaves."""
        ...

    @property
    def l_m(self) -> Scalar:
        """How far the weight reaches [u]."""
        ...

    @property
    def eps_m(self) -> Scalar:
        """Bounds the weight at contact."""
        ...


def push(
    c: LeafGains,
    x: Float[Array, "*leaves"],
    xd: Float[Array, "*leaves"],
    closing: Float[Array, "*leaves"],
) -> Float[Array, "*leaves"]:
    """The acceleration f [u/s^2], away from the obstacle; `closing` is s."""
    return c.k_p * jnp.exp(-x / c.l_p) - c.k_v * closing * xd / (x / c.l_d + c.eps_d)


def metric(
    c: LeafGains,
    x: Float[Array, "*leaves"],
    closing: Float[Array, "*leaves"],
    gate: Float[Array, "*leaves"],
) -> Float[Array, "*leaves"]:
    """How much the push counts against the other leaves, m; `closing` is s, `gate` g."""
    return closing * gate * c.mu_r / (x / c.l_m + c.eps_m)
