"""Where the real meshes are looked for."""

from drpbench.robot import find_mesh_model


def test_meshes_are_looked_for_where_the_environment_says(tmp_path, monkeypatch):
    for name in ("MENAGERIE_ROOT", "DRPBENCH_MESHES"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("MENAGERIE_CACHE_DIR", str(tmp_path / "none"))
    assert find_mesh_model() is None

    monkeypatch.setenv("DRPBENCH_MESHES", str(tmp_path))
    assert find_mesh_model() is None
    (tmp_path / "panda.xml").write_text("<mujoco/>")
    assert find_mesh_model() == tmp_path / "panda.xml"
    (tmp_path / "panda_collision.xml").write_text("<mujoco/>")
    assert find_mesh_model() == tmp_path / "panda_collision.xml"


def test_meshes_are_found_in_a_menagerie_cache(tmp_path, monkeypatch):
    for name in ("MENAGERIE_ROOT", "DRPBENCH_MESHES"):
        monkeypatch.delenv(name, raising=False)
    folder = tmp_path / "some-version" / "franka_emika_panda"
    folder.mkdir(parents=True)
    (folder / "panda.xml").write_text("<mujoco/>")
    monkeypatch.setenv("MENAGERIE_CACHE_DIR", str(tmp_path))
    assert find_mesh_model() == folder / "panda.xml"
