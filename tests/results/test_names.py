"""What a result file is called, and what is named after it."""

from pathlib import Path

import pytest

from drpbench.results.names import (
    batches_folder,
    forms,
    is_compressed,
    is_result,
    log_file,
    recordings_folder,
    trajectories_file,
)


@pytest.mark.parametrize("form", [".json", ".json.gz"])
@pytest.mark.parametrize("stem", ["x", "a.b", "x.json", "rmp-FDO", "straight+dcp-rmp", ".x"])
def test_both_forms_of_a_result_share_what_lies_beside_them(stem, form):
    path = Path("runs") / f"{stem}{form}"
    assert is_result(path) and is_compressed(path) == (form == ".json.gz")
    assert forms(path) == (Path(f"runs/{stem}.json"), Path(f"runs/{stem}.json.gz"))
    assert log_file(path) == Path(f"runs/{stem}{form}.partial")
    assert trajectories_file(path) == Path(f"runs/{stem}.npz")
    assert batches_folder(path) == Path(f"runs/{stem}.trajectories")
    assert recordings_folder(path) == Path(f"runs/{stem}")


@pytest.mark.parametrize(
    "name", ["x.txt", "x.gz", "x", "x.json.partial", "x.json.gz.partial", ".json", ".json.gz", ""]
)
def test_what_is_no_result(name):
    assert not is_result(Path("runs") / name if name else "")
