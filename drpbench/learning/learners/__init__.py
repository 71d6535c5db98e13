"""Learners by name: the known ones, those of installed packages, and yours by import path."""

from __future__ import annotations

from collections.abc import Mapping

from drpbench.learning.learner import Learner, LearnerError
from drpbench.plugins.imported import built
from drpbench.plugins.networks import named

from .impact import ImpactLearner
from .lstm_gmm import LstmGmmLearner

LEARNERS: Mapping[str, type[Learner]] = {
    "impact": ImpactLearner,
    "neuralmp": LstmGmmLearner,
}


def learner(name: str, size: str | None = None) -> Learner:
    """The learner that `name` describes, of a named size, by default its first: `impact`; yours by
    import path, `my_package.my_module:MyLearner`, or by the name under which your installed package
    offers it.

    Raises LearnerError or PolicyError, each one line.
    """
    kind = named(name, LEARNERS)
    if not hasattr(kind, "sizes"):
        raise LearnerError(f"{name}: expected a subclass of drpbench.learning.Learner")
    sizes = built(name, kind.sizes, {})
    if size is None:
        return next(iter(sizes.values()))
    if size not in sizes:
        raise LearnerError(f"no size {size!r}; there are: {', '.join(sizes)}")
    return sizes[size]
