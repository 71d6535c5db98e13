"""Every score that README and docs tell is counted again from the shipped rows."""

import re
from functools import cache
from pathlib import Path

import pytest

from drpbench.contract import PROTOCOL
from drpbench.problems import load_set
from drpbench.ranking import load_dir
from drpbench.results.shipped import shipped_results

ROOT = Path(__file__).parents[1]
TABLES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
SENTENCES = sorted((ROOT / "docs" / "policies").glob("*.md"))
LEAST = 100  # of n in a sentence: smaller ones are of parameters, seeds, settings
# What a row of a table is of, where that is no policy but the page's.
MEASURES = {
    "success": lambda row: row.success,
    "success by the deadline": lambda row: row.success_before_removal,
}


@cache
def shipped():
    """Valid rows by policy and protocol."""
    found = {}
    for result in load_dir(shipped_results()).values():
        rows = found.setdefault((result.header.policy, result.header.protocol), [])
        rows += [row for row in result.rows if row.valid]
    return found


def rows_of(policy, text):
    """The policy's rows by the protocol that the text names, or the newest; none if there are
    none."""
    versions = {protocol for name, protocol in shipped() if name == policy}
    named = {int(number) for number in re.findall(r"protocol (\d+)", text)}
    return shipped().get((policy, max(named or versions, default=0)), [])


def told_in_tables(text, page):
    """(place, k, n, share or None, rows, measure) of each cell `k/n share` under a task, in a row
    that is of a policy or, on a policy's page, of a measure."""
    blocks = re.split(r"\n\s*\n", text)
    for block, before in zip(blocks, ["", *blocks], strict=False):
        lines = [
            [cell.strip(" `") for cell in line.strip("|").split("|")]
            for line in block.strip().splitlines()
            if line.startswith("|")
        ]
        if len(lines) < 3 or not set(load_set().tasks) & set(lines[0]):
            continue
        # A leaderboard has a table for each measure; that of other measures than success is
        # compared whole elsewhere.
        if re.match(r"(Reached|Collided|Success (by|if|without))", before):
            continue
        for line in lines[2:]:
            label = next((cell for cell in line if re.search("[a-z]", cell)), "")
            policy, measure = (page, label) if label in MEASURES else (label, "success")
            for task, cell in zip(lines[0], line, strict=True):
                found = re.match(r"(\d+)/(\d+)(?:,? (\d+\.?\d*))?", cell)
                if found and task in load_set().tasks:
                    rows = [row for row in rows_of(policy, before) if row.task == task]
                    k, n, share = found.groups()
                    yield f"{policy} {task}", int(k), int(n), share, rows, MEASURES[measure]


def wrong_in_tables(text, page=""):
    """Places of cells that are not what the rows are, and how many cells were compared."""
    wrong, compared = [], 0
    for place, k, n, share, rows, measure in told_in_tables(text, page):
        if not rows:  # of a policy or a protocol that is not shipped
            continue
        compared += 1
        won = sum(bool(measure(row)) for row in rows)
        right = (won, len(rows)) == (k, n)
        if not right or (share and abs(float(share) - 100 * k / n) > 0.0501):
            wrong.append(f"{place}: {k}/{n}, expected {won}/{len(rows)}")
    return wrong, compared


@cache
def countable(policy, protocol):
    """Every (k, n) that a sentence may tell of a policy: its successes and failures, of a task, a
    level, a family or a pair of it; of the failures those that touch, and those that do not."""
    groups = {}
    for row in shipped()[policy, protocol]:
        problems = load_set().task(row.task)
        kinds = {"", problems.family[row.id], problems.pair[row.id], int(problems.level[row.id])}
        for kind in kinds:
            groups.setdefault((row.task, kind), []).append(row)
    found = set()
    for rows in groups.values():
        lost = [row for row in rows if not row.success]
        touched = sum(row.collided for row in lost)
        found |= {(len(rows) - len(lost), len(rows)), (len(lost), len(rows))}
        found |= {(touched, len(lost)), (len(lost) - touched, len(lost))}
    return found


def wrong_in_sentences(text, page):
    """Sentences with a count that none of the policies on the page has, and how many were
    compared."""
    names = {page, f"straight+{page}", *re.findall(r"`([a-z+-]+)`", text)}
    wrong, compared = [], 0
    for paragraph in re.split(r"\n\s*\n|\n- ", text):
        told = " ".join(line for line in paragraph.splitlines() if not line.startswith("|"))
        for said in re.finditer(r"(\d+) of (?:its )?(\d+)\b", told):
            k, n = map(int, said.groups())
            if n < LEAST:
                continue
            # A count is of today's protocol, unless its sentence names another.
            named = {int(number) for number in re.findall(r"protocol (\d+)", told)} or {PROTOCOL}
            of = [key for key in shipped() if key[0] in names and key[1] in named]
            if not of:
                continue
            compared += 1
            if not any((k, n) in countable(*key) for key in of):
                wrong.append(f"{said[0]}: {told[:100]}")
    return wrong, compared


def test_tables_of_scores_are_those_of_the_shipped_rows():
    compared = 0
    for page in TABLES:
        wrong, there = wrong_in_tables(page.read_text(), page.stem)
        assert wrong == [], page.name
        compared += there
    assert compared > 20


@pytest.mark.parametrize("page", SENTENCES, ids=lambda page: page.stem)
def test_counts_in_sentences_on_a_policy_are_those_of_the_shipped_rows(page):
    wrong, _ = wrong_in_sentences(page.read_text(), page.stem)
    assert wrong == []


def test_a_wrong_score_is_found():
    """Whichever policies are shipped: one count more than there is, in a table and a sentence."""
    (policy, protocol), rows = next(
        (key, rows) for key, rows in shipped().items() if any(row.task == "FDO" for row in rows)
    )
    rows = [row for row in rows if row.task == "FDO"]
    won, n = sum(row.success for row in rows), len(rows)
    text = (
        f"Under protocol {protocol}:\n\n| | FDO |\n|---|---|\n| `{policy}` | {{}}/{n}, {{}} % |\n"
    )
    assert wrong_in_tables(text.format(won, f"{100 * won / n:.1f}")) == ([], 1)
    assert wrong_in_tables(text.format(won + 1, f"{100 * (won + 1) / n:.1f}"))[0]
    assert wrong_in_tables(text.format(won, f"{100 * won / n + 1:.1f}"))[0]
    said = f"Under protocol {protocol} it solves {{}} of {n + 1000} in FDO."
    assert wrong_in_sentences(said.format(won), policy)[0]
    assert wrong_in_sentences(said.format(won).replace(str(n + 1000), str(n)), policy) == ([], 1)
