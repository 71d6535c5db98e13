"""`drpbench` in a process of its own, with two lanes a batch instead of 64: soon done."""

import sys

DRPBENCH = [
    sys.executable,
    "-c",
    "import drpbench.evaluation.run as run; run.LANES = 2; from drpbench.cli import main; main()",
]
"""A command, but for its arguments."""
