"""The README's own example is a policy, and its links lead somewhere."""

import re
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest

from drpbench.contract import Observation, Policy
from drpbench.robot import PANDA

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text()
SNIPPETS = re.findall(r"```python\n(.*?)```", README, re.DOTALL)


def test_the_example_is_a_policy():
    names = {}
    (example,) = (text for text in SNIPPETS if "class Creep" in text)
    exec(example, names)
    policy = names["Creep"]()
    assert isinstance(policy, Policy)
    home = jnp.asarray(PANDA.home, jnp.float32)
    seen = Observation(
        joint_position=home,
        joint_velocity=jnp.zeros(7),
        goal_joints=home + 1.0,
        goal_position=jnp.zeros(3),
        goal_quaternion=jnp.array([1.0, 0.0, 0.0, 0.0]),
        scene_points=jnp.zeros((2048, 3)),
        scene_mask=jnp.zeros(2048, bool),
        robot_points=jnp.zeros((256, 3)),
    )
    target, _ = policy.act(seen, policy.init(seen), None)
    np.testing.assert_allclose(target, home + 0.1, rtol=1e-6)


@pytest.mark.slow
def test_the_first_example_runs_as_it_stands(capsys):
    example = SNIPPETS[0].replace("problems=20", "problems=2")
    assert example != SNIPPETS[0]
    exec(example, {})
    assert "FDO" in capsys.readouterr().out


def test_links_and_pictures_are_there():
    pages = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]
    for page in pages:
        for target in re.findall(r"\]\(([^)#]+)\)", page.read_text()):
            if target.startswith("https://"):
                continue
            assert (page.parent / target).exists(), f"{page.name} points to {target}"


def test_the_scores_shown_are_those_of_the_shipped_rows():
    from drpbench.problems import load_set
    from drpbench.ranking import build, load_dir
    from drpbench.ranking.markdown import render_markdown
    from drpbench.results.shipped import shipped_results

    everything = render_markdown(build(load_dir(shipped_results()), load_set().counts)).strip()
    success = "\n\n".join(everything.split("\n\n")[1:3])
    assert success.startswith("Success") and "| rmp | " in success
    told = "python scripts/write_scores.py writes the shipped results' scores"
    assert f"\n{success}\n" in README, told
    assert f"\n{everything}\n" in (ROOT / "docs" / "scores.md").read_text(), told


def test_the_counts_that_pages_tell_of_policies_are_those_of_the_shipped_rows():
    """Sentences such as: `straight` succeeds in 35 of 200 episodes."""
    from drpbench.problems import load_set
    from drpbench.ranking import build, load_dir
    from drpbench.results.shipped import shipped_results

    board = build(load_dir(shipped_results()), load_set().counts)
    cells = {entry.policy: entry.cells for entry in board.entries}
    checked = 0
    for page in sorted((ROOT / "docs" / "tasks").glob("*.md")):
        task, text = page.stem.upper(), " ".join(page.read_text().split())
        for sentence in re.split(r"(?<=\.) (?=[A-Z`\[])", text):
            for said in re.finditer(r"(\d+) of (\d+) episodes", sentence):
                if "succeed" not in sentence[: said.start()]:
                    continue
                for policy in re.findall(r"`([a-z+-]+)`", sentence[: said.start()]):
                    cell = cells[policy][task].success
                    assert (cell.k, cell.n) == tuple(map(int, said.groups())), (page.name, sentence)
                    checked += 1
    assert checked >= 4
