"""Where the real Panda meshes are, for what checks itself against them. They are not part of drpbench."""

import os
from pathlib import Path

NO_MESHES = (
    "the real Panda meshes were not found: set DRPBENCH_MESHES to a folder with panda_collision.xml "
    "or panda.xml, or install the package mujoco-menagerie and fetch franka_emika_panda with it"
)


def find_mesh_model() -> Path | None:
    """MJCF of the Panda with its meshes, or None.

    Looked for in the folder that the environment variable `DRPBENCH_MESHES` names, then in the cache
    of an installed `mujoco-menagerie`. Never downloads.
    """
    roots = []
    if named := os.environ.get("DRPBENCH_MESHES"):
        roots.append(Path(named))
    if root := os.environ.get("MENAGERIE_ROOT"):
        roots.append(Path(root) / "franka_emika_panda")
    cache = Path(os.environ.get("MENAGERIE_CACHE_DIR", Path.home() / ".cache" / "mujoco_menagerie"))
    if cache.is_dir():
        roots.extend(sorted(cache.glob("**/franka_emika_panda")))
    for root in roots:
        for name in ("panda_collision.xml", "panda.xml"):
            if (root / name).is_file():
                return root / name
    return None
