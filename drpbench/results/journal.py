"""The log of a run in progress: rows are safe as soon as they are appended.

A run that will end as ``x.json`` keeps ``x.json.partial`` meanwhile, one that will end compressed
as ``x.json.gz`` keeps ``x.json.gz.partial``: plain JSON lines, the header first, then one line per
row, and before each block of rows a line with the seconds spent on it. Every block is flushed to
the disk before :meth:`Journal.append` returns, so a run killed at any moment resumes with every
appended row and repeats none.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterable, Mapping
from io import FileIO
from pathlib import Path
from typing import Self

from pydantic import BaseModel, ConfigDict, NonNegativeFloat, ValidationError

from drpbench.results.names import forms, log_file

from .schema import Header, Result, ResultsError, Row, describe, load, reason, save

try:
    import fcntl
except ImportError:  # not POSIX: two runs on one file are then not kept apart
    fcntl = None  # type: ignore[assignment]

MAY_DIFFER = frozenset({"about", "name", "batch_size", "platform", "created", "wall_seconds"})
"""The header's fields that move no number; a resumed run keeps those of its beginning."""


class _Elapsed(BaseModel):
    model_config = ConfigDict(strict=True, extra="forbid", allow_inf_nan=False)
    wall_seconds: NonNegativeFloat


class Journal:
    """A run's rows on disk, from the first to the finished result file.

    Made by :meth:`create` or :meth:`resume`; a context manager that closes the log (without
    finishing the run) on exit.

    Attributes:
        path: the result file the run will end as.
        header: the header the run began with.
        done: (task, id) of every row held.
        wall_seconds: time spent on the rows held [s].
        finished: whether the result file is written; then there is nothing left to append.
    """

    def __init__(self, path: Path, header: Header, file: FileIO | None):
        self.path = path
        self.header = header
        self.done: set[tuple[str, int]] = set()
        self.wall_seconds = 0.0
        self.finished = False
        self._rows: list[Row] = []
        self._file = file

    @classmethod
    def create(cls, path: str | os.PathLike[str], header: Header) -> Self:
        """Begins a run that will end as ``path``.

        Raises:
            ResultsError: the result file or its log exists, as it is named or in its other form,
                or cannot be written.
        """
        path, partial = _paths(path)
        _require_no_other_form(path)
        if path.exists():
            raise ResultsError(f"{path}: exists; nothing overwritten. Name another file with --out")
        if partial.exists():
            with contextlib.suppress(OSError), partial.open("rb", buffering=0) as there:
                _lock(there, partial)  # its run may be alive
            raise ResultsError(
                f"{partial}: holds an unfinished run; continue it with --resume,"
                " or name another file with --out"
            )
        try:
            partial.parent.mkdir(parents=True, exist_ok=True)
            file = partial.open("xb", buffering=0)
        except OSError as error:
            raise ResultsError(f"{partial}: cannot be written: {reason(error)}") from None
        _lock(file, partial)
        journal = cls(path, header, file)
        journal._write(_line(header))
        return journal

    @classmethod
    def resume(cls, path: str | os.PathLike[str], header: Header) -> Self:
        """Goes on with the run that will end as ``path``, or begins it where there is none.

        A last line torn by a kill is dropped. A run that had finished comes back as finished.

        Args:
            path: the result file.
            header: what is asked for now; must agree with the stored header in everything that
                affects results.

        Raises:
            ResultsError: the stored run is damaged, in use, in its other form, or was made with
                other settings.
        """
        path, partial = _paths(path)
        _require_no_other_form(path)
        try:
            file = partial.open("r+b", buffering=0)
        except FileNotFoundError:
            return cls._reopen(path, header) if path.exists() else cls.create(path, header)
        except OSError as error:
            raise ResultsError(f"{partial}: cannot be read: {reason(error)}") from None
        _lock(file, partial)
        try:
            # Killed between writing the result file and removing the log, or while we opened it.
            if path.exists():
                journal = cls._reopen(path, header)
                partial.unlink(missing_ok=True)
                file.close()
                return journal
            return cls._read(path, partial, header, file)
        except BaseException:
            file.close()
            raise

    @classmethod
    def _reopen(cls, path: Path, header: Header) -> Self:
        result = load(path)
        _require_same_settings(path, result.header, header)
        journal = cls(path, result.header, None)
        journal._hold(result.rows)
        journal.wall_seconds = result.header.wall_seconds
        journal.finished = True
        return journal

    @classmethod
    def _read(cls, path: Path, partial: Path, header: Header, file: FileIO) -> Self:
        text = file.read()
        whole = text.rfind(b"\n") + 1
        lines = text[:whole].split(b"\n")[:-1]
        if not lines:
            opening = _line(header)[:20]
            if not (text.startswith(opening) or opening.startswith(text)):
                raise ResultsError(f"{partial}: line 1: is not the log of a run")
            file.truncate(0)
            file.seek(0)
            journal = cls(path, header, file)
            journal._write(_line(header))
            return journal
        journal = cls(path, header, file)
        for number, line in enumerate(lines, start=1):
            try:
                if number == 1:
                    journal.header = Header.model_validate_json(line)
                    _require_same_settings(partial, journal.header, header)
                elif line.startswith(b'{"wall_seconds"'):
                    journal.wall_seconds += _Elapsed.model_validate_json(line).wall_seconds
                else:
                    row = Row.model_validate_json(line)
                    journal._check([row])
                    journal._hold([row])
            except ValidationError as error:
                raise ResultsError(f"{partial}: line {number}: {describe(error)}") from None
            except _Refused as error:
                raise ResultsError(f"{partial}: line {number}: {error}") from None
        file.truncate(whole)
        file.seek(whole)
        return journal

    def append(self, rows: Iterable[Row], seconds: float = 0.0) -> None:
        """Puts a block of rows on the disk; when this returns, no kill can lose them.

        Args:
            rows: outcomes not held yet, of instances the header asks for.
            seconds: time spent on this block [s], summed into the header's ``wall_seconds``.

        Raises:
            ResultsError: a row is held already or was not asked for (then none is written), the
                run is finished, or the disk refuses.
        """
        rows = list(rows)
        if self._file is None:
            raise ResultsError(f"{self.path}: the run is finished or closed; no row can be added")
        try:
            self._check(rows)
        except _Refused as error:
            raise ResultsError(f"{self.path}: {error}") from None
        if not rows:
            return
        self._write(_line(_Elapsed(wall_seconds=seconds)) + b"".join(map(_line, rows)))
        self._hold(rows)
        self.wall_seconds += seconds

    def finish(self) -> Result:
        """Writes the result file, rows in order, and removes the log.

        Raises:
            ResultsError: problems asked for by id have no row, or the file cannot be written.
        """
        order = {task: index for index, task in enumerate(self.header.tasks)}
        try:
            result = Result(
                header=self.header.model_copy(update={"wall_seconds": self.wall_seconds}),
                rows=sorted(self._rows, key=lambda row: (order[row.task], row.id)),
            )
        except ValidationError as error:
            raise ResultsError(f"{self.path}: cannot finish: {describe(error)}") from None
        if self.finished:
            return result
        path, partial = _paths(self.path)
        for form in forms(path):
            if form.exists():
                raise ResultsError(
                    f"{form}: appeared during the run; not overwritten, rows: {partial}"
                )
        save(result, path)
        # Removed before the lock is let go, so that nobody resumes a finished run's log.
        partial.unlink(missing_ok=True)
        self.close()
        self.finished = True
        return result

    def close(self) -> None:
        """Lets go of the log; what was appended stays for :meth:`resume`."""
        if self._file is not None:
            self._file.close()
            self._file = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        # A run that failed before its first row leaves nothing that could be resumed.
        if self._file is not None and not self._rows:
            _paths(self.path)[1].unlink(missing_ok=True)
        self.close()

    def _check(self, rows: Iterable[Row]) -> None:
        new: set[tuple[str, int]] = set()
        for row in rows:
            if row.key in self.done or row.key in new:
                raise _Refused(f"{row.task} {row.id} stands there already")
            if not self.header.admits(*row.key):
                raise _Refused(f"{row.task} {row.id} was not asked for in the header")
            new.add(row.key)

    def _hold(self, rows: list[Row]) -> None:
        self._rows.extend(rows)
        self.done.update(row.key for row in rows)

    def _write(self, block: bytes) -> None:
        rest = memoryview(block)
        assert self._file is not None, "the log is open while rows are written"
        try:
            while rest:
                rest = rest[self._file.write(rest) :]
            os.fsync(self._file.fileno())
        except BaseException as error:
            # A torn line may only ever be the last one: nothing more goes into this log.
            self.close()
            if isinstance(error, OSError):
                partial = _paths(self.path)[1]
                raise ResultsError(f"{partial}: cannot be written: {reason(error)}") from None
            raise


class _Refused(ValueError):
    """A row that doesn't belong; the caller adds where it stood."""


def _paths(path: str | os.PathLike[str]) -> tuple[Path, Path]:
    return Path(path), log_file(path)


def _require_no_other_form(path: Path) -> None:
    # Trajectories and recordings of x.json and x.json.gz would have the same names.
    for form in forms(path):
        if form == path:
            continue
        if form.exists():
            raise ResultsError(
                f"{form}: exists; {path.name} beside it would be the same result twice."
                " Name another file with --out"
            )
        if log_file(form).exists():
            raise ResultsError(
                f"{log_file(form)}: holds an unfinished run; continue it with --resume --out "
                f"{form},"
                " or name another file with --out"
            )


def _line(record: BaseModel) -> bytes:
    return record.model_dump_json().encode() + b"\n"


def _lock(file: FileIO, partial: Path) -> None:
    # The kernel drops the lock with the process, so a kill leaves nothing behind.
    if fcntl is None:
        return
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        file.close()
        raise ResultsError(f"{partial}: another run is writing to it") from None


def _require_same_settings(file: Path, stored: Header, wanted: Header) -> None:
    differences = []
    for name in Header.model_fields:
        if name in MAY_DIFFER:
            continue
        there, now = getattr(stored, name), getattr(wanted, name)
        if isinstance(there, Mapping):
            for key in sorted(there.keys() | now.keys()):
                if there.get(key, "absent") != now.get(key, "absent"):
                    pair = there.get(key, "absent"), now.get(key, "absent")
                    differences.append((f"{name}.{key}", *pair))
        elif there != now:
            differences.append((name, there, now))
    if differences:
        told = "; ".join(f"{name} was {_brief(a)}, is {_brief(b)}" for name, a, b in differences)
        raise ResultsError(
            f"{file}: cannot be resumed with other settings: {told}. Name another file with --out"
        )


def _brief(value: object) -> str:
    if value is None:
        return "all"
    text = str(value)
    return text if len(text) <= 40 else text[:37] + "..."
