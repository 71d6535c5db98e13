"""The result file: one JSON per run, plain or compressed, a header and one row per problem
instance.

Every figure the project publishes is recomputed from rows, so a row holds what was measured and
nothing aggregated. The models are strict: no unknown field, no NaN or infinity, no string where
a number belongs. Give them plain Python values (``array.tolist()``), not NumPy scalars.

The published JSON Schema beside this file, ``result.schema.json``, is the output of
:func:`schema_json`.
"""

from __future__ import annotations

import gzip
import json
import os
import zlib
from collections.abc import Iterable
from pathlib import Path
from typing import Annotated, BinaryIO, Literal, Self

from pydantic import (
    BaseModel,
    ConfigDict,
    FailFast,
    Field,
    NonNegativeFloat,
    NonNegativeInt,
    PositiveInt,
    ValidationError,
    model_validator,
)

from drpbench.errors import DrpbenchError
from drpbench.results.names import is_compressed

SCHEMA_VERSION: Literal[1] = 1

LARGEST = 256_000_000
"""[bytes] What a result file may hold, uncompressed; a run of all problems holds 2 MB."""

VERSIONED = ("drpbench", "python", "jax", "jaxlib", "mujoco", "mujoco-mjx", "numpy")
"""The software whose version affects results; a header names each."""

Scalar = bool | int | float | str
Name = Annotated[str, Field(min_length=1)]
Metres = NonNegativeFloat


class ResultsError(DrpbenchError):
    """A result file cannot be read, written or resumed; the message is one line."""


class _Record(BaseModel):
    model_config = ConfigDict(strict=True, extra="forbid", frozen=True, allow_inf_nan=False)


class Header(_Record):
    """Everything that affects the rows, and what was asked for."""

    schema_version: Literal[1] = Field(
        default=SCHEMA_VERSION, description="version of this file format"
    )
    protocol: PositiveInt = Field(
        default=1, description="version of the protocol, which says what a score means"
    )
    policy: Name = Field(description="name of the policy, as given to `drpbench run --policy`")
    name: str = Field(default="", description="what the run is called, where it has its own name")
    about: str = Field(
        default="", description="what the policy is, where its name does not say all of it"
    )
    policy_parameters: dict[str, Scalar | list[Scalar]] = Field(
        description="the policy's parameters by name"
    )
    isolated: bool = Field(
        default=False, description="whether the policy was in a process that keeps no score"
    )
    privileged: bool = Field(description="whether the policy was given the obstacle models")
    tasks: list[Name] = Field(min_length=1, description="tasks run, in the order of the rows")
    problem_set: Name = Field(description="name and version of the frozen problems: drpbench-v1")
    problem_set_sha256: str = Field(pattern="^[0-9a-f]{64}$", description="its checksum")
    seed: int = Field(description="seed of the run")
    precision: Name = Field(description="floating-point type of the simulation: float32")
    device: Name = Field(description="accelerator or processor the run was made on")
    processor: str = Field(
        default="", description="processor's model, family and vector instructions"
    )
    environment: dict[str, str] = Field(
        default_factory=dict, description="variables of JAX and XLA that were set"
    )
    batch_size: PositiveInt = Field(description="instances simulated at once")
    versions: dict[str, str] = Field(description="version of each software that affects results")
    platform: str = Field(description="operating system and machine")
    created: str = Field(
        pattern=r"^\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d(\.\d+)?(Z|\+00:00)$",
        description="when the run began, ISO 8601 in UTC",
    )
    problems: dict[str, list[NonNegativeInt] | None] = Field(
        description="per task the ids asked for; null means every problem of the task"
    )
    wall_seconds: NonNegativeFloat = Field(description="time spent on the rows [s]")
    shard: str = Field(
        default="",
        pattern=r"^([1-9]\d*/[1-9]\d*)?$",
        description="which part of a run this is: 3/16",
    )

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        if len(set(self.tasks)) != len(self.tasks):
            raise ValueError(f"tasks names a task twice: {', '.join(self.tasks)}")
        if set(self.problems) != set(self.tasks):
            raise ValueError("problems and tasks name different tasks")
        for task, ids in self.problems.items():
            if ids is not None and len(set(ids)) != len(ids):
                raise ValueError(f"problems.{task} holds an id twice")
        missing = [name for name in VERSIONED if name not in self.versions]
        if missing:
            raise ValueError(f"versions lacks {', '.join(missing)}")
        return self

    @property
    def called(self) -> str:
        """What the run is shown as: its own name, or its policy's."""
        return self.name or self.policy

    def admits(self, task: str, instance: int) -> bool:
        """Whether the run was asked for this instance."""
        if task not in self.problems:
            return False
        ids = self.problems[task]
        return ids is None or instance in ids


class Row(_Record):
    """The outcome of one instance. Final values are those at the last control step."""

    id: NonNegativeInt = Field(description="index of the problem within its task")
    task: Name
    family: Name = Field(description="scene family of the problem")
    success: bool = Field(description="reached and never collided")
    reached: bool = Field(description="at the last step within 1 cm and 15 degrees of the goal")
    reached_5cm: bool = Field(description="at the last step within 5 cm and 15 degrees")
    reached_once: bool = Field(description="within 1 cm and 15 degrees at any step")
    collided: bool = Field(description="any link but the fixed base touched an obstacle")
    first_collision_step: NonNegativeInt | None = Field(description="control step")
    first_collision_link: str | None
    self_collided: bool = Field(description="reported only; no part of success")
    min_clearance: float | None = Field(
        description="smallest signed distance to any obstacle [m]; null without obstacles"
    )
    position_error: Metres | None = Field(description="final hand position error [m]")
    orientation_error: NonNegativeFloat | None = Field(description="final hand angle error [rad]")
    time_to_goal: NonNegativeFloat | None = Field(
        description="time from which the goal stays reached to the end [s]; null if not reached"
    )
    joint_path_length: NonNegativeFloat | None = Field(description="[rad]")
    ee_path_length: Metres | None = Field(description="length of the hand's path [m]")
    sparc_joint: float | None = Field(description="spectral arc length of the joint speed")
    sparc_ee: float | None = Field(description="spectral arc length of the hand's speed")
    joint_limit_violation: bool
    time_at_goal_before_removal: NonNegativeFloat | None = Field(
        default=None,
        description="time at the goal (1 cm, 15 degrees) while boxes were still to be met [s]; null"
        " where none ever vanish",
    )
    success_before_removal: bool | None = Field(
        default=None,
        description="at the goal at the last step before the boxes vanish, without a collision so"
        " far; null where none ever vanish",
    )
    status: Name = Field(
        default="ok", description="ok, or why the instance failed to run: nan, ..."
    )
    valid: bool = Field(
        default=True, description="false keeps the row out of every rate (SAO, GB: no box came)"
    )

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        problem = None
        if self.success != (self.reached and not self.collided):
            problem = "success must be exactly: reached and not collided"
        elif self.reached and not (self.reached_5cm and self.reached_once):
            problem = "reached implies reached_5cm and reached_once"
        elif self.reached != (self.time_to_goal is not None):
            problem = "time_to_goal must be a number exactly where reached is true"
        elif self.collided != (self.first_collision_step is not None):
            problem = "first_collision_step must be a number exactly where collided is true"
        elif self.collided != (self.first_collision_link is not None):
            problem = "first_collision_link must be named exactly where collided is true"
        elif self.status != "ok":
            if self.reached:
                problem = f"reached must be false where status is {self.status}"
        else:
            for field in (
                "position_error",
                "orientation_error",
                "joint_path_length",
                "ee_path_length",
            ):
                if getattr(self, field) is None:
                    problem = f"{field} may be null only where status is not ok"
        if problem:
            raise ValueError(f"{self.task} {self.id}: {problem}")
        return self

    @property
    def key(self) -> tuple[str, int]:
        """What names the instance: task and id."""
        return self.task, self.id


class Result(_Record):
    """A finished run: rows sorted by task, in the header's order, then by id."""

    header: Header
    rows: Annotated[list[Row], FailFast()]

    @model_validator(mode="after")
    def _complete(self) -> Self:
        seen: dict[str, set[int]] = {task: set() for task in self.header.tasks}
        for index, row in enumerate(self.rows):
            if row.task not in seen:
                raise ValueError(f"rows[{index}]: task {row.task} is not in the header's tasks")
            if row.id in seen[row.task]:
                raise ValueError(f"rows[{index}]: {row.task} {row.id} stands twice")
            seen[row.task].add(row.id)
        for task, ids in self.header.problems.items():
            if ids is None or seen[task] == set(ids):
                continue
            if extra := seen[task] - set(ids):
                raise ValueError(f"rows: {task} {min(extra)} was not asked for in the header")
            missing = set(ids) - seen[task]
            raise ValueError(
                f"rows: {len(missing)} of the {len(ids)} {task} problems asked for are missing"
                f" (first: {min(missing)})"
            )
        return self


def load(path: str | os.PathLike[str]) -> Result:
    """Reads and checks a result file.

    Raises:
        ResultsError: the file is missing, damaged, too large, not JSON, of another schema version,
            or a field is missing, of the wrong kind or at odds with another; the message names
            file and field.
    """
    text = _read(path)
    try:
        return Result.model_validate_json(text)
    except ValidationError as error:
        raise ResultsError(f"{path}: {describe(error)}") from None


def _read(path: str | os.PathLike[str]) -> bytes:
    try:
        with gzip.open(path) if is_compressed(path) else open(path, "rb") as file:
            text = file.read(LARGEST + 1)
    except (gzip.BadGzipFile, EOFError, zlib.error) as error:
        raise ResultsError(f"{path}: is not gzip, or damaged ({error})") from None
    except OSError as error:
        raise ResultsError(f"{path}: cannot be read: {reason(error)}") from None
    if len(text) > LARGEST:
        raise ResultsError(
            f"{path}: holds more than {LARGEST / 1e6:g} MB, which no result file does"
        )
    return text


def save(result: Result, path: str | os.PathLike[str]) -> None:
    """Writes a result file whole or not at all, with one row a line; compressed as its name says.

    The same result is written as the same bytes (compressed: by the same zlib).

    Raises:
        ResultsError: the file cannot be written.
    """
    path = Path(path)
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            with temporary.open("wb") as file:
                _write(file, "".join(_lines(result)).encode(), is_compressed(path))
                file.flush()
                os.fsync(file.fileno())
            os.replace(temporary, path)
        finally:
            temporary.unlink(missing_ok=True)
    except OSError as error:
        raise ResultsError(f"{path}: cannot be written: {reason(error)}") from None


def _write(file: BinaryIO, text: bytes, compressed: bool) -> None:
    if not compressed:
        file.write(text)
        return
    # Neither name nor time in gzip's header: the bytes are the content's alone.
    with gzip.GzipFile("", "wb", compresslevel=9, fileobj=file, mtime=0) as packed:
        packed.write(text)


def _lines(result: Result) -> Iterable[str]:
    yield f'{{\n"header": {result.header.model_dump_json(indent=2)},\n"rows": ['
    separator = "\n"
    for row in result.rows:
        yield separator + row.model_dump_json()
        separator = ",\n"
    yield "\n]\n}\n"


def schema_json() -> str:
    """The JSON Schema of a result file, as published in ``result.schema.json``."""
    schema = {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        **Result.model_json_schema(),
    }
    return json.dumps(schema, indent=2) + "\n"


def reason(error: OSError) -> str:
    """The operating system's words for an error, without number and path."""
    return (error.strerror or type(error).__name__).lower()


def describe(error: ValidationError) -> str:
    """The first thing a validation found wrong, in one line that begins with the field's name."""
    errors = error.errors(include_url=False)
    version = [e for e in errors if e["loc"][-1:] == ("schema_version",)]
    first = (version or errors)[0]
    place = ""
    for part in first["loc"]:
        place += f"[{part}]" if isinstance(part, int) else f".{part}" if place else str(part)
    match first["type"]:
        case "json_invalid":
            return f"is not JSON, or cut short ({first['ctx']['error']})"
        case "missing":
            return f"{place} is missing"
        case "extra_forbidden":
            return f"{place} is not a field of the format"
        case "value_error":
            message = str(first["ctx"]["error"])
            return f"{place}: {message}" if place else message
        case "literal_error" if version:
            return f"{place} is {_brief(first['input'])}; this drpbench reads {SCHEMA_VERSION}"
    message = first["msg"][0].lower() + first["msg"][1:]
    return f"{place + ': ' if place else ''}{message}, got {_brief(first['input'])}"


def _brief(value: object) -> str:
    text = " ".join(repr(value).split())
    return text if len(text) <= 60 else text[:57] + "..."
