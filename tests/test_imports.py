"""What importing does: it starts no backend, and the package's own name costs next to nothing."""

import json
import pkgutil
import subprocess
import sys

import drpbench

# `__main__` runs the command line.
MODULES = sorted(
    found.name
    for found in pkgutil.walk_packages(drpbench.__path__, "drpbench.")
    if not found.name.endswith("__main__")
)
# What an extra brings, and what of the package needs it.
EXTRAS = {
    "gymnasium": "drpbench.gym",
    "stable_baselines3": "drpbench.gym.stable_baselines",
    "viser": "drpbench.viewer",
}


def told(code: str) -> dict:
    """What a fresh interpreter prints as JSON."""
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert ran.returncode == 0, ran.stderr
    return json.loads(ran.stdout)


def test_no_module_starts_a_backend():
    """So that `jax.distributed.initialize()` and the choice of a platform may come after any
    import."""
    code = f"""
import importlib, json
absent = set()
for name in {MODULES!r}:
    try:
        importlib.import_module(name)
    except ImportError as error:
        absent.add((error.name or "").split(".")[0])
from jax._src import xla_bridge
print(json.dumps({{"backends": list(xla_bridge._backends), "absent": sorted(absent)}}))
"""
    found = told(code)
    assert len(MODULES) > 100
    assert found["backends"] == []
    assert set(found["absent"]) <= set(EXTRAS)


def test_the_packages_name_imports_nothing_heavy():
    code = """
import json, sys, time
began = time.process_time()
import drpbench
seconds = time.process_time() - began
heavy = {"jax", "numpy", "mujoco", "flax", "scipy"} & set(sys.modules)
print(json.dumps({"seconds": seconds, "heavy": sorted(heavy)}))
"""
    found = told(code)
    assert found["heavy"] == [] and found["seconds"] < 0.1
