"""Sealed problem sets: the benchmark's families and numbers, drawn from a secret.

Whoever does not know the secret cannot know the problems, so nobody can have learned them or look
them up. With the same secret the same problems are drawn again. They are written as JSON lines,
which `--problems-from` reads; the set's name holds a fingerprint of the secret.
"""

from __future__ import annotations

import hashlib
import json
import multiprocessing
import os
from collections.abc import Callable, Mapping
from concurrent.futures import ProcessPoolExecutor
from functools import cache
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from drpbench.errors import InputError
from drpbench.geometry import stacked
from drpbench.planning.checker import mesh_checker, sphere_checker
from drpbench.problems.lines import header_line, to_json
from drpbench.problems.task_problems import TaskProblems
from drpbench.robot import PANDA

from .composition import COMPOSITION, size_of
from .generator import CHECKER_MARGIN, Draft, Generator

LEAST_SECRET = 16  # [bytes]


def secret_of(path: Path) -> bytes:
    """The secret in a file. Raises InputError for one that can be guessed."""
    try:
        secret = path.read_bytes().strip()
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({(error.strerror or '').lower()})") from None
    if len(secret) < LEAST_SECRET or len(set(secret)) < LEAST_SECRET // 2:
        raise InputError(
            f"{path}: expected at least {LEAST_SECRET} bytes that nobody can guess, got "
            f"{len(secret)}; make some with: head -c 32 /dev/urandom > {path}"
        )
    return secret


def name_of(secret: bytes) -> str:
    """The set's name: it shows whether two sets are of one secret, and nothing of the secret."""
    return f"sealed-{hashlib.sha256(b'name of ' + secret).hexdigest()[:12]}"


def counts(most: int | None = None) -> dict[str, int]:
    """How many problems of each task: the benchmark's numbers, or at most `most`."""
    return {task: min(size_of(task), most or size_of(task)) for task in COMPOSITION}


def draw(
    out: Path,
    secret: bytes,
    wanted: Mapping[str, int],
    workers: int,
    progress: Callable[[int], None],
) -> None:
    """Draws and certifies the problems and writes them to `out`; goes on where it was cut off.

    Certificates are by the spheres, and by the real meshes where they are found. `progress` is told
    of every problem that is there. Raises InputError where `out` exists, or another set's beginning
    lies beside it.
    """
    if out.exists():
        raise InputError(f"{out}: exists; nothing overwritten. Name another file with --out")
    partial = out.with_name(out.name + ".partial")
    header = header_line(name_of(secret), list(wanted))
    jobs = [(task, index) for task, count in wanted.items() for index in range(count)]
    done = _resumed(partial, header, jobs)
    for _ in range(done):
        progress(1)
    out.parent.mkdir(parents=True, exist_ok=True)
    with (
        partial.open("a", encoding="utf-8") as file,
        ProcessPoolExecutor(workers, multiprocessing.get_context("spawn")) as pool,
    ):
        if not done and not file.tell():
            file.write(header + "\n")
        left = iter(jobs[done:])
        ahead = [pool.submit(_line, secret, *job) for job in islice(left, 8 * workers)]
        while ahead:
            file.write(ahead.pop(0).result() + "\n")
            file.flush()
            progress(1)
            ahead += [pool.submit(_line, secret, *job) for job in islice(left, 1)]
    os.replace(partial, out)


def _resumed(partial: Path, header: str, jobs: list[tuple[str, int]]) -> int:
    """How many problems lie in the beginning of a set; a torn last line is dropped."""
    if not partial.exists():
        return 0
    text = partial.read_text(encoding="utf-8")
    whole = text[: text.rfind("\n") + 1]
    lines = whole.splitlines()
    if lines and lines[0] != header:
        raise InputError(f"{partial}: holds the beginning of another set; name another --out")
    partial.write_text(whole, encoding="utf-8")
    return min(max(len(lines) - 1, 0), len(jobs))


@cache
def _generator() -> Generator:
    """One a process: it holds compiled checkers."""
    meshes = PANDA.meshes.find() if PANDA.meshes else None
    return Generator(sphere_checker(CHECKER_MARGIN), mesh_checker(meshes) if meshes else None)


def _line(secret: bytes, task: str, index: int) -> str:
    key = hashlib.sha256(secret + f"/{task}/{index}".encode()).digest()
    draft = _generator().problem(task, index, np.frombuffer(key, np.uint32).tolist())
    return json.dumps(as_json(draft))


def as_json(draft: Draft) -> dict[str, Any]:
    """A generated problem as a line of a problem set has it."""
    one = TaskProblems(
        task=draft.task,
        obstacles=stacked([draft.scene.obstacles]),
        start=draft.start[None],
        goal=draft.goal[None],
        goal_position=draft.goal_position[None],
        goal_quaternion=draft.goal_quaternion[None],
        family=[draft.group.family],
        pair=[draft.group.pair],
        level=np.array([draft.group.level], np.int32),
        witness=[draft.witness],
    )
    return to_json(one, 0) | {"id": draft.index}
