"""The documentation builds without a warning, and what it shows lies in it."""

import importlib
import re
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[1]


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """The built site's folder. Broken links, anchors and names of the reference are errors."""
    folder = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(folder)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    return folder


def test_every_page_of_the_documentation_is_in_the_navigation(site):
    navigation = (ROOT / "mkdocs.yml").read_text().split("\nnav:")[1]
    pages = {str(p.relative_to(ROOT / "docs")) for p in (ROOT / "docs").rglob("*.md")}
    assert pages <= set(re.findall(r"[\w/-]+\.md", navigation))
    assert all((site / page).with_suffix(".html").is_file() for page in pages)


def test_the_site_loads_nothing_from_elsewhere(site):
    pages = sorted(site.rglob("*.html"))
    assert len(pages) > 20
    for page in pages:
        tags = re.findall(r"<(?:script|img|iframe|source|link)\b[^>]*>", page.read_text())
        found = [tag for tag in tags if re.search(r"""\b(?:src|href)=["']?(?:https?:)?//""", tag)]
        assert not found, f"{page.name}: {found}"


def test_notebooks_and_root_pages_are_pages(site):
    for page, said in {
        "index.html": "Does a manipulator policy survive a moving world?",
        "contributing.html": "pre-commit",
        "changelog.html": "Unreleased",
        "notebooks/evaluate_your_policy.html": "drpbench",
        "notebooks/look_at_failures.html": "first_collision_link",
    }.items():
        assert said in re.sub(r"<[^>]+>", "", (site / page).read_text()), page


def reference():
    """(module, name) of everything that the API reference names."""
    for page in sorted((ROOT / "docs" / "reference").glob("*.md")):
        shown = re.findall(r"^::: (\S+)\n.*\n\s+members: \[(.*)\]", page.read_text(), re.MULTILINE)
        yield from ((module, name.strip()) for module, names in shown for name in names.split(","))


@pytest.mark.parametrize(("module", "name"), list(reference()))
def test_the_reference_names_what_there_is_and_is_documented(module, name):
    found = getattr(importlib.import_module(module), name)
    assert name == name.upper() or found.__doc__
