"""The folder of a run's tables: which files there are, whether a run may write there, and how
tables grow.

A table that grows while the run goes on is a folder of numbered Parquet files, its parts. The
others are one file each.
"""

import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import msgspec
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from orchard.field.scenario import Scenario
from orchard.folders import half_written, write_whole
from orchard.tables.columns import (
    AS_JSON,
    BODIES,
    CALLS,
    EVENTS,
    EXCHANGES,
    MESSAGES,
    SUMMARY,
)

# Regular expression: the names of a table's files in its folder.
PART = r"\d{6,}\.parquet"
# Rows of a file. The newest file is written again until it has as many.
MOST_ROWS = 50_000
# Columns of numbers that seldom come twice. They compress better if all first bytes are stored
# together, then all second bytes, and so on (BYTE_STREAM_SPLIT), than by a dictionary of values.
PLANES = ("x", "y", "yaw", "measured_x", "measured_y", "odometry_x", "odometry_y", "odometry_yaw")


def write_table(path: Path, table: pa.Table) -> None:
    """Write a table in place of an old one, wholly or not at all. Raises OSError."""
    sink = pa.BufferOutputStream()
    others = [name for name in table.column_names if name not in PLANES]
    planes = {name: "BYTE_STREAM_SPLIT" for name in table.column_names if name in PLANES}
    pq.write_table(table, sink, compression="zstd", use_dictionary=others, column_encoding=planes)
    write_whole(path, sink.getvalue().to_pybytes())


class GrowingTable:
    """One table of a run: a folder of Parquet files, a data set.

    Its rows come in the order of `tick`.
    """

    def __init__(self, folder: Path, schema: pa.Schema, until: int) -> None:
        """Open the table, and remove the rows from tick `until` on: the run does these steps anew.

        Raises OSError.
        """
        self.schema = schema
        self._folder = folder
        folder.mkdir(parents=True, exist_ok=True)
        for torn in half_written(folder, PART):
            torn.unlink()
        self._remove_from(until)
        # Of the newest part, from 1: behind those that an earlier process of the run has written.
        self._number = max((int(part.stem) for part in files_of(folder)), default=0) + 1
        # The rows of the newest part, which is written again with each addition until it is full.
        self._newest = schema.empty_table()

    def add(self, rows: pa.Table) -> None:
        """Add rows, and write them to the disk. Raises OSError."""
        if not len(rows):
            return
        self._newest = pa.concat_tables([self._newest, rows])
        write_table(self._part(self._number), self._newest)
        if len(self._newest) >= MOST_ROWS:
            self._newest = self.schema.empty_table()
            self._number += 1

    def finish(self) -> None:
        """Leave a file without rows if there is none, so that the table has its columns.

        Raises OSError.
        """
        if not files_of(self._folder):
            write_table(self._part(self._number), self._newest)

    def _part(self, number: int) -> Path:
        return self._folder / f"{number:06d}.parquet"

    def _remove_from(self, until: int) -> None:
        """Remove the rows from tick `until` on, and files that then have no rows."""
        for part in reversed(files_of(self._folder)):
            rows = pq.read_table(part)
            early = rows.filter(pc.field("tick") < until)
            if len(early) == len(rows) > 0:
                # Rows are in the order of ticks, so the files before have early rows only.
                return
            if len(early):
                write_table(part, early.replace_schema_metadata(self.schema.metadata))
            else:
                part.unlink()


def files_of(table: Path) -> list[Path]:
    """Return the files of a table, in the order of their rows: itself, or those in its folder.

    Files that a user has put beside these are not of the table.
    """
    if table.is_file():
        return [table]
    return sorted(path for path in table.glob("*.parquet") if re.fullmatch(PART, path.name))


# The key of the scenario, as JSON, in the metadata of each file.
SCENARIO = b"orchard.scenario"
# Table -> its columns: tables that grow while the run goes on, and those written at its end.
GROWING = {"bodies": BODIES, "events": EVENTS, "messages": MESSAGES}
AT_THE_END = {"calls": CALLS, "exchanges": EXCHANGES}
SUMMARY_NAME = "summary"


def path_of(folder: Path, table: str) -> Path:
    """Return where a table is: a folder of files if it grows while the run goes on, else a file."""
    return folder / f"{table}.parquet"


def check_folder(folder: Path, scenario: Scenario, tick: int | None = None) -> None:
    """Make the folder, and check that a run may write its tables there.

    `tick`: at which a resumed run goes on; None: a new run. A resumed run goes on with its own
    tables. Raises OSError, or ValueError for other tables there.
    """
    # What a user can do, at the end of each message.
    instead = "; --table DIR names another folder"
    if tick is not None and files_of(path_of(folder, "bodies")):
        _check_tables(folder, scenario, tick, instead)
    else:
        _check_empty(folder, instead)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        # Whether files can be made there is known only by making one.
        probe = folder / ".orchard"
        probe.touch()
        probe.unlink()
    except OSError as error:
        raise OSError(
            f"{folder}: tables cannot be written there: {error.strerror}{instead}"
        ) from error


def _check_empty(folder: Path, instead: str) -> None:
    """Raise ValueError if a folder has anything in the place of a table."""
    for name in (*GROWING, *AT_THE_END, SUMMARY_NAME):
        path = path_of(folder, name)
        if not path.exists():
            continue
        if files_of(path_of(folder, "bodies")):
            raise ValueError(f"{folder}: tables of a run are there, and are not replaced{instead}")
        raise ValueError(f"{path}: it has the name of a table, and is not replaced{instead}")


def _check_tables(folder: Path, scenario: Scenario, tick: int, instead: str) -> None:
    """Raise ValueError if the tables in a folder are not those of a run that goes on at a tick."""
    there = f"{folder}: the tables there"
    try:
        file = files_of(path_of(folder, "bodies"))[-1]
        kept_scenario = (pq.read_schema(file).metadata or {}).get(SCENARIO, b"{}")
        last = last_tick(folder)
    except (pa.ArrowException, OSError) as error:
        raise ValueError(f"{there} cannot be read: {error}{instead}") from error
    if msgspec.json.decode(kept_scenario) != msgspec.json.decode(scenario.model_dump_json()):
        raise ValueError(f"{there} are of another scenario{instead}")
    if last != tick and path_of(folder, SUMMARY_NAME).exists():
        raise ValueError(
            f"{there} are of a run that ended at tick {last}, "
            f"and this one goes on at tick {tick}: its rows would be lost{instead}"
        )
    if last < tick:
        raise ValueError(
            f"{there} end at tick {last}, and the run goes on at tick {tick}: "
            f"rows would be missing{instead}"
        )


def last_tick(folder: Path) -> int:
    """Return the last tick with rows; 0 if there is none. Raises OSError or ArrowException."""
    files = files_of(path_of(folder, "bodies"))
    if not files:
        return 0
    ticks = pq.read_table(files[-1], columns=["tick"])["tick"]
    if len(ticks) == 0:
        return 0
    return int(ticks[-1].as_py())


def complete(folder: Path, summary: Mapping[str, Any]) -> list[str]:
    """Write the summary of a run beside its other tables.

    Return what is wrong with the tables, such as missing rows, in sentences; [] if all is well.
    """
    try:
        write_table(path_of(folder, SUMMARY_NAME), as_table(summary))
        last = last_tick(folder)
    except (OSError, ValueError, pa.ArrowException) as error:
        why = getattr(error, "strerror", None) or error
        return [f"{folder}: the tables cannot be written or read: {why}"]
    ticks = summary["ticks"]
    if last != ticks:
        return [f"{folder}: the tables end at tick {last}, and the run at tick {ticks}"]
    return []


def as_table(summary: Mapping[str, Any]) -> pa.Table:
    """Return a summary as one row of the schema SUMMARY, whatever happened in the run.

    Null: the summary has no such value.
    """
    values = dict(_values(summary))
    if unknown := values.keys() - set(SUMMARY.names):
        raise ValueError(f"the summary's {', '.join(sorted(unknown))}: no such column")
    metadata = {SCENARIO: msgspec.json.encode(summary["scenario"]).decode()}
    return pa.Table.from_pylist([values], SUMMARY.with_metadata(metadata))


def _values(summary: Mapping[str, Any], before: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the column and the value of each key of a summary, dictionaries within it included.

    What is null is left out. `before`: the keys that lead there, as "forked_from.".
    """
    for key, value in summary.items():
        name = before + key
        if name in AS_JSON or name == "scenario":
            yield name, msgspec.json.encode(value).decode()
        elif isinstance(value, Mapping):
            yield from _values(value, f"{name}.")
        elif value is not None:
            yield name, value
