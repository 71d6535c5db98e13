"""What a run was made on: device, processor, software, and the settings that were set from
outside."""

import importlib.metadata
import os
import platform
from pathlib import Path

import jax

from drpbench import __version__

_VECTORS = ("sse4_2", "avx", "avx2", "fma", "avx512f", "avx512_bf16", "amx_tile", "asimd", "sve")
_SETTINGS = ("JAX_", "XLA_", "NVIDIA_TF32_OVERRIDE", "TF_CPP_")
_NOT_NUMBERS = ("JAX_COMPILATION_CACHE_DIR", "JAX_PLATFORMS", "TF_CPP_MIN_LOG_LEVEL")


def device_name() -> str:
    """The accelerator or processor that JAX runs on."""
    device = jax.devices()[0]
    if device.platform != "cpu":
        return device.device_kind
    return _cpuinfo().get("model name") or platform.processor() or "cpu"


def processor() -> str:
    """The processor's model, family, stepping and vector instructions: XLA rounds after these.

    Two processors of one name may differ in them. On an accelerator it is the host's.
    """
    found = _cpuinfo()
    name = found.get("model name") or platform.processor() or platform.machine()
    numbers = [
        f"{word} {found[key]}"
        for key, word in (("cpu family", "family"), ("model", "model"), ("stepping", "stepping"))
        if key in found
    ]
    flags = set((found.get("flags") or found.get("Features") or "").split())
    vectors = " ".join(name for name in _VECTORS if name in flags)
    return "; ".join(part for part in (name, ", ".join(numbers), vectors) if part)


def environment() -> dict[str, str]:
    """The variables that are set for JAX and XLA, but for those that change no number."""
    return {
        name: value
        for name, value in sorted(os.environ.items())
        if name.startswith(_SETTINGS) and name not in _NOT_NUMBERS
    }


def versions() -> dict[str, str]:
    """The version of each software that affects results."""
    packages = ("jax", "jaxlib", "mujoco", "mujoco-mjx", "numpy")
    found = {name: importlib.metadata.version(name) for name in packages}
    return {"drpbench": __version__, "python": platform.python_version(), **found}


def _cpuinfo() -> dict[str, str]:
    """The first processor's lines of /proc/cpuinfo, where there is one."""
    try:
        text = Path("/proc/cpuinfo").read_text()
    except OSError:
        return {}
    lines = (line.partition(":") for line in text.split("\n\n")[0].splitlines())
    return {name.strip(): value.strip() for name, _, value in lines}
