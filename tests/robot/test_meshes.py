"""Where the real meshes are looked for."""

import sys

from drpbench.robot import PANDA


def test_meshes_are_looked_for_where_the_environment_says(tmp_path, monkeypatch):
    for name in ("MENAGERIE_ROOT", "DRPBENCH_MESHES"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("MENAGERIE_CACHE_DIR", str(tmp_path / "none"))
    assert PANDA.meshes.find() is None

    monkeypatch.setenv("DRPBENCH_MESHES", str(tmp_path))
    assert PANDA.meshes.find() is None
    (tmp_path / "panda.xml").write_text("<mujoco/>")
    assert PANDA.meshes.find() == tmp_path / "panda.xml"
    (tmp_path / "panda_collision.xml").write_text("<mujoco/>")
    assert PANDA.meshes.find() == tmp_path / "panda_collision.xml"


def test_meshes_are_found_where_the_menagerie_package_keeps_them(tmp_path, monkeypatch):
    for name in ("MENAGERIE_ROOT", "DRPBENCH_MESHES", "MENAGERIE_CACHE_DIR"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    folder = tmp_path / "mujoco_menagerie" / "models" / "franka_emika_panda-3d2262eeb81ecec1"
    folder.mkdir(parents=True)
    assert PANDA.meshes.find() is None
    (folder / "panda.xml").write_text("<mujoco/>")
    assert PANDA.meshes.find() == folder / "panda.xml"
    monkeypatch.setenv("MENAGERIE_CACHE_DIR", str(tmp_path / "mujoco_menagerie"))
    monkeypatch.delenv("XDG_CACHE_HOME")
    assert PANDA.meshes.find() == folder / "panda.xml"
