"""Drawing without a screen: which OpenGL MuJoCo uses, and a buffer to draw into."""

import ctypes
import importlib
import os
import subprocess
import sys
from collections.abc import Callable

import mujoco
import numpy as np

from .episode import RecordingError

NO_RENDERER = (
    "no renderer: neither EGL nor OSMesa works here; on Debian or Ubuntu: "
    "apt-get install libegl1 libgl1-mesa-dri (EGL), or libosmesa6 (OSMesa)"
)
_PROBE = "import mujoco.egl as gl; gl.GLContext(8, 8).make_current()"


def _egl_works() -> bool:
    # In a process of its own: what PyOpenGL loads first it keeps, and a broken driver may crash.
    environment = {**os.environ, "PYOPENGL_PLATFORM": "egl", "MUJOCO_GL": "egl"}
    try:
        # Without closing files it is spawned, not forked: JAX warns of forks.
        tried = subprocess.run(
            [sys.executable, "-c", _PROBE],
            env=environment,
            capture_output=True,
            timeout=60,
            close_fds=False,
        )
    except (OSError, subprocess.TimeoutExpired):
        return False
    return tried.returncode == 0


def _osmesa_works() -> bool:
    for name in ("libOSMesa.so", "libOSMesa.so.8", "libOSMesa.so.6"):
        try:
            ctypes.CDLL(name)
        except OSError:
            continue
        return True
    return False


_WORKS: dict[str, Callable[[], bool]] = {"egl": _egl_works, "osmesa": _osmesa_works}


def choose_platform() -> str:
    """`egl` where it works, else `osmesa`; the environment variable MUJOCO_GL decides before both.

    Raises RecordingError where what is asked for, or any of them, does not work.
    """
    named = os.environ.get("MUJOCO_GL", "").lower()
    if not named:
        for platform, works in _WORKS.items():
            if works():
                return platform
        raise RecordingError(NO_RENDERER)
    if named not in _WORKS:
        raise RecordingError(f"MUJOCO_GL={named}: videos are drawn with egl or osmesa; unset it")
    if not _WORKS[named]():
        raise RecordingError(f"MUJOCO_GL={named} does not work here; unset it, or {NO_RENDERER}")
    return named


class Canvas:
    """A buffer of width x height pixels that MuJoCo draws scenes of one model into."""

    def __init__(self, model: mujoco.MjModel, width: int, height: int):
        self.width, self.height = width, height
        platform = choose_platform()
        try:
            self._gl = importlib.import_module(f"mujoco.{platform}").GLContext(width, height)
        except Exception as error:  # PyOpenGL's errors have no common base
            raise RecordingError(f"{NO_RENDERER} ({platform}: {_line(error)})") from None
        self._gl.make_current()
        model.vis.global_.offwidth, model.vis.global_.offheight = width, height
        scale = mujoco.mjtFontScale
        font = scale.mjFONTSCALE_50 if width < 480 else scale.mjFONTSCALE_100
        self._context = mujoco.MjrContext(model, font)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, self._context)
        extent = model.stat.extent
        self._near, self._far = model.vis.map.znear * extent, model.vis.map.zfar * extent
        self._area = mujoco.MjrRect(0, 0, width, height)

    def draw(self, scene: mujoco.MjvScene, caption: str = "") -> tuple[np.ndarray, np.ndarray]:
        """The picture (height, width, 3) uint8 and its depth (height, width) [m], the first row on
        top.

        The caption stands in the upper left corner.
        """
        self._gl.make_current()
        mujoco.mjr_render(self._area, scene, self._context)
        if caption:
            corner, font = mujoco.mjtGridPos.mjGRID_TOPLEFT, mujoco.mjtFont.mjFONT_NORMAL
            mujoco.mjr_overlay(font, corner, self._area, caption, "", self._context)
        picture = np.empty((self.height, self.width, 3), np.uint8)
        depth = np.empty((self.height, self.width), np.float32)
        mujoco.mjr_readPixels(picture, depth, self._area, self._context)
        # OpenGL's depth is 0 on the near plane, 1 on the far plane, and linear in 1/z.
        near, far = self._near, self._far
        return picture[::-1], near / (1.0 - depth[::-1] * (1.0 - near / far))

    def close(self) -> None:
        """Gives the buffer back."""
        self._context.free()
        self._gl.free()


def _line(error: Exception) -> str:
    return " ".join(str(error).split()) or type(error).__name__
