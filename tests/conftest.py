"""Shapes and types are checked at run time in every test."""

from jaxtyping import install_import_hook

install_import_hook(
    [
        "drpbench.robot",
        "drpbench.geometry",
        "drpbench.envs",
        "drpbench.policies",
        "drpbench.baselines",
        "drpbench.learning",
    ],
    "beartype.beartype",
)
