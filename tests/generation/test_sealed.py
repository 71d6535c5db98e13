"""Sealed sets: the same secret draws the same problems, resumed or not; another one others."""

import json

import pytest

from drpbench.errors import InputError
from drpbench.generation import sealed
from drpbench.generation.composition import group_of
from drpbench.problems import load_set

pytestmark = pytest.mark.slow  # certificates


@pytest.fixture(scope="module")
def secret(tmp_path_factory):
    path = tmp_path_factory.mktemp("secret") / "seed"
    path.write_bytes(bytes(range(7, 39)))
    return path


@pytest.fixture(scope="module")
def drawn(tmp_path_factory, secret):
    out = tmp_path_factory.mktemp("set") / "sealed.jsonl"
    sealed.draw(out, sealed.secret_of(secret), {"SE": 1, "DGB": 2}, 2, lambda n: None)
    return out


def test_it_is_a_problem_set_of_the_benchmarks_groups(drawn, secret):
    found = load_set(drawn)
    assert found.name == sealed.name_of(sealed.secret_of(secret))
    assert found.counts == {"SE": 1, "DGB": 2}
    for task, count in found.counts.items():
        for index in range(count):
            group = group_of(task, index)
            assert found.task(task).family[index] == group.family
            assert found.task(task).level[index] == group.level
    public = load_set()
    assert not (found.task("SE").start[0] == public.task("SE").start).all(axis=1).any()


def test_it_goes_on_where_it_was_cut_off(drawn, secret, tmp_path):
    out, lines = tmp_path / "again.jsonl", drawn.read_text().splitlines(keepends=True)
    partial = tmp_path / "again.jsonl.partial"
    partial.write_text("".join(lines[:2]) + lines[2][:40])
    seen = []
    sealed.draw(out, sealed.secret_of(secret), {"SE": 1, "DGB": 2}, 1, seen.append)
    assert out.read_text() == drawn.read_text() and sum(seen) == 3
    (tmp_path / "other.jsonl.partial").write_text(json.dumps({"name": "another"}) + "\n")
    with pytest.raises(InputError, match="beginning of another set"):
        sealed.draw(tmp_path / "other.jsonl", b"x" * 32, {"SE": 1}, 1, seen.append)
    with pytest.raises(InputError, match="exists"):
        sealed.draw(out, b"x" * 32, {"SE": 1}, 1, seen.append)


def test_a_secret_that_can_be_guessed_is_refused(tmp_path):
    short = tmp_path / "short"
    for content in (b"1234", b"a" * 64):
        short.write_bytes(content)
        with pytest.raises(InputError, match="expected at least 16 bytes .* head -c 32"):
            sealed.secret_of(short)
    with pytest.raises(InputError, match="cannot be read"):
        sealed.secret_of(tmp_path / "nowhere")
