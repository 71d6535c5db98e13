"""The repository stays small, whatever results are added to it."""

import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
LARGEST = 30_000_000  # [bytes] without the history


def test_a_checkout_is_below_30_mb():
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True)
    if listed.returncode:
        pytest.skip(f"not a git checkout: {listed.stderr.strip()}")
    files = [ROOT / name for name in listed.stdout.split("\0") if name]
    sizes = {str(file.relative_to(ROOT)): file.stat().st_size for file in files if file.is_file()}
    largest = sorted(sizes, key=sizes.get)[-5:]
    assert 0 < sum(sizes.values()) < LARGEST, {name: sizes[name] for name in largest}
