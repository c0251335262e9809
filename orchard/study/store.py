"""The store of a study: an SQLite file with a row for each run (`RunRecord`).

A run that is in it, and not damaged, is never done again. A store belongs to one version of this
software, because another version may give other results.
"""

import os
import sqlite3
from collections.abc import Iterable
from contextlib import closing, suppress
from dataclasses import fields
from pathlib import Path
from typing import Any

import msgspec

from orchard.folders import regular
from orchard.study.runs import RunRecord, software

# "ORCH" as a number. It stands in the head of the file, and tells a store from other databases.
APPLICATION = 0x4F524348
# s to wait for another study that writes to the same store.
PATIENCE = 30.0
# Values in one statement, at most. SQLite allows at least 999 in all its versions.
MOST_PARAMETERS = 500
COLUMNS = [field.name for field in fields(RunRecord)]


class StoreError(ValueError):
    """A store that cannot be used: the text names the file, and says what would be right."""


class StoreFailed(Exception):
    """A store that failed while it was used, as on a full disk: the text names the file, and says
    why.
    """


class Store:
    """The runs that are known, by key.

    Only the parent process of a study writes; several studies may share a store.
    """

    def __init__(self, path: Path, anew: bool = False) -> None:
        """Open a store, or make it.

        `anew`: forget the runs of a store of another version. Raises StoreError.
        """
        self.path = path
        # Key of a run that was asked for, and whose row cannot be right -> why.
        self.damaged: dict[str, str] = {}
        try:
            self._prepare(anew)
            self._database = sqlite3.connect(path, timeout=PATIENCE, isolation_level=None)
            self._database.execute("PRAGMA journal_mode = WAL")
            self._database.text_factory = _text
        except (OSError, sqlite3.Error) as error:
            why = getattr(error, "strerror", None) or error
            raise StoreError(f"{path}: cannot be used as a store: {why}") from None

    def _prepare(self, anew: bool) -> None:
        """Make the file if there is none, or one of another version that may be forgotten."""
        if not self.path.exists():
            self.path.parent.mkdir(parents=True, exist_ok=True)
            empty = self._made()
            # A link fails if another study has made the file meanwhile; then that one is used.
            with suppress(FileExistsError):
                os.link(empty, self.path)
            empty.unlink()
        fault = fault_of(self.path, anew)
        if fault:
            raise StoreError(f"{self.path}: {fault}")
        if _version(self.path) != software():
            # It may be forgotten. SQLite's files beside it belong to the old store.
            empty = self._made()
            for rest in ("-wal", "-shm"):
                self.path.with_name(self.path.name + rest).unlink(missing_ok=True)
            empty.replace(self.path)

    def _made(self) -> Path:
        """Write an empty store under another name, and return its path.

        The caller puts it in its place when it is complete, so that no study sees half a store.
        """
        half = self.path.with_name(f"{self.path.name}.{os.getpid()}")
        try:
            self._fill(half)
        except (OSError, sqlite3.Error):
            # As on a full disk. SQLite has removed the files that it writes beside it.
            half.unlink(missing_ok=True)
            raise
        return half

    def _fill(self, half: Path) -> None:
        """Write an empty store into a new file."""
        columns = []
        for name in COLUMNS:
            if name == "key":
                columns.append(f"{name} PRIMARY KEY")
            else:
                columns.append(f"{name} NOT NULL")
        with closing(sqlite3.connect(half, isolation_level=None)) as database:
            database.execute(f"PRAGMA application_id = {APPLICATION}")
            database.execute("CREATE TABLE software (version TEXT NOT NULL)")
            database.execute("INSERT INTO software VALUES (?)", (software(),))
            database.execute(f"CREATE TABLE runs ({', '.join(columns)})")

    def __enter__(self) -> "Store":
        return self

    def __exit__(self, *_: object) -> None:
        self._database.close()

    def known(self, keys: Iterable[str]) -> dict[str, RunRecord]:
        """Return the runs with these keys that are in the store: key -> run.

        A damaged one is left out, and noted in `damaged`. Raises StoreFailed.
        """
        wanted = list(keys)
        records: dict[str, RunRecord] = {}
        for begin in range(0, len(wanted), MOST_PARAMETERS):
            some = wanted[begin : begin + MOST_PARAMETERS]
            rows = self._do(
                "SELECT {} FROM runs WHERE key IN ({})", some, "the runs in it cannot be read"
            )
            for row in rows:
                values = dict(zip(COLUMNS, row, strict=True))
                try:
                    records[values["key"]] = msgspec.convert(values, RunRecord)
                except msgspec.ValidationError as error:
                    self.damaged[values["key"]] = str(error)
        return records

    def keep(self, record: RunRecord) -> None:
        """Keep a run. It replaces a row with the same key, which is damaged or equal.

        Raises StoreFailed.
        """
        self._do(
            "INSERT OR REPLACE INTO runs ({}) VALUES ({})",
            [getattr(record, name) for name in COLUMNS],
            "a run cannot be kept",
        )

    def _do(self, statement: str, values: list[Any], fault: str) -> list[tuple[Any, ...]]:
        """Execute a statement, and return its rows. Raises StoreFailed with the text `fault`.

        `statement`: has two places, {}: for the names of all columns, and for a `?` for each value.
        """
        columns = ", ".join(COLUMNS)
        places = ", ".join("?" * len(values))
        try:
            return self._database.execute(statement.format(columns, places), values).fetchall()
        except sqlite3.Error as error:
            raise StoreFailed(f"{self.path}: {fault}: {error}") from None


def fault_of(path: Path, anew: bool) -> str:
    """Return why a file cannot be the store of a study; '' if it can. The file is only read."""
    version = _version(path)
    if version is None:
        return "is no store of a study; it stays as it is; name another file with --out"
    if version != software() and not anew:
        return (
            f"is a store of version {version}, and this is {software()}; --anew forgets its runs,"
            " --out names another file"
        )
    return ""


def _text(content: bytes) -> str | bytes:
    """Return a text of the database. Bytes that are no text stay: then the row is damaged."""
    try:
        return content.decode()
    except UnicodeDecodeError:
        return content


def _version(path: Path) -> str | None:
    """Return the version of a store; None if the file is no store, or cannot be read."""
    try:
        address = f"{regular(path).absolute().as_uri()}?mode=ro&immutable=1"
        with closing(sqlite3.connect(address, uri=True)) as database:
            if database.execute("PRAGMA application_id").fetchone() != (APPLICATION,):
                return None
            row = database.execute("SELECT version FROM software").fetchone()
    except (OSError, sqlite3.Error):
        return None
    if row is None:
        return None
    return str(row[0])
