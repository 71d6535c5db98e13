"""Where the real Panda meshes are, for what checks itself against them. They are not part of
drpbench."""

import os
import sys
from pathlib import Path

NO_MESHES = (
    "the real Panda meshes were not found: set DRPBENCH_MESHES to a folder with "
    "panda_collision.xml "
    "or panda.xml, or: pip install mujoco-menagerie && mujoco-menagerie prefetch franka_emika_panda"
)


def find_mesh_model() -> Path | None:
    """MJCF of the Panda with its meshes, or None.

    Looked for in the folder that the environment variable `DRPBENCH_MESHES` names, then where the
    package `mujoco-menagerie` keeps what it has fetched. Never downloads.
    """
    roots = []
    if named := os.environ.get("DRPBENCH_MESHES"):
        roots.append(Path(named))
    if root := os.environ.get("MENAGERIE_ROOT"):
        roots.append(Path(root) / "franka_emika_panda")
    # One folder a version: franka_emika_panda-3d2262eeb81ecec1.
    roots.extend(sorted(_menagerie_cache().glob("models/franka_emika_panda-*")))
    for folder in roots:
        for name in ("panda_collision.xml", "panda.xml"):
            if (folder / name).is_file():
                return folder / name
    return None


def _menagerie_cache() -> Path:
    """The cache folder of `mujoco-menagerie`, whether it is installed or not."""
    if named := os.environ.get("MENAGERIE_CACHE_DIR"):
        return Path(named)
    if sys.platform == "win32":
        local = os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local"
        return Path(local) / "mujoco_menagerie" / "cache"
    if sys.platform == "darwin":
        return Path.home() / "Library" / "Caches" / "mujoco_menagerie"
    cache = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(cache) / "mujoco_menagerie"
