"""The whole package is clean under the type checker, and says that it is typed."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]


@pytest.mark.slow
def test_the_package_is_clean_under_mypy(tmp_path):
    checked = subprocess.run(
        [sys.executable, "-m", "mypy", "--cache-dir", str(tmp_path)],
        cwd=ROOT,
        capture_output=True,
        text=True,
    )
    assert checked.returncode == 0, checked.stdout + checked.stderr


def test_the_package_says_that_it_is_typed():
    assert (ROOT / "drpbench" / "py.typed").is_file()


def public_functions(path):
    """Functions and methods of a module that no name on their way marks as private."""

    def within(body):
        for node in body:
            if isinstance(node, ast.FunctionDef) and not node.name.startswith("_"):
                yield node
            elif isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                yield from within(node.body)

    return within(ast.parse(path.read_text()).body)


def lacking(function):
    given = function.args
    named = [*given.posonlyargs, *given.args, *given.kwonlyargs, given.vararg, given.kwarg]
    bare = [
        argument.arg
        for argument in named
        if argument and argument.annotation is None and argument.arg not in ("self", "cls")
    ]
    return bare + ["what it returns"] * (function.returns is None)


def test_every_public_function_is_annotated():
    found = {
        f"{path.relative_to(ROOT)}:{function.lineno} {function.name}": missing
        for path in sorted((ROOT / "drpbench").rglob("*.py"))
        for function in public_functions(path)
        if (missing := lacking(function))
    }
    assert not found


def test_an_annotation_that_lacks_is_noticed(tmp_path):
    source = tmp_path / "module.py"
    source.write_text("class A:\n    def f(self, x, *, y: int): ...\n    def _g(self, z): ...\n")
    (function,) = public_functions(source)
    assert lacking(function) == ["x", "what it returns"]
