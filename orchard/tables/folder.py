"""The folder of a run's tables: its files, and whether a run may write there."""

from pathlib import Path

import msgspec
import pyarrow as pa
import pyarrow.parquet as pq

from orchard.field.scenario import Scenario
from orchard.tables.columns import BODIES, CALLS, EVENTS, EXCHANGES, MESSAGES
from orchard.tables.parts import files_of

SCENARIO = b"orchard.scenario"  # in the metadata of each file: the scenario as JSON
GROWING = {"bodies": BODIES, "events": EVENTS, "messages": MESSAGES}  # while the run goes on
AT_THE_END = {"calls": CALLS, "exchanges": EXCHANGES}


def path_of(folder: Path, table: str) -> Path:
    """Return where a table is: a folder of files if it grows while the run goes on, else a file."""
    return folder / f"{table}.parquet"


def metadata_of(scenario: Scenario) -> dict[bytes, str]:
    """Return the metadata of each file."""
    return {SCENARIO: scenario.model_dump_json()}


def check_folder(folder: Path, scenario: Scenario, tick: int | None = None) -> None:
    """Make the folder, if it is not there. `tick`: at which a resumed run goes on; None for a new run.

    Raises OSError if it cannot be written, ValueError if its tables are of another run, or end before `tick`.
    """
    instead = "; --table DIR names another folder"
    if files_of(path_of(folder, "bodies")):
        if tick is None:
            raise ValueError(f"{folder}: tables of a run are there, and are not replaced{instead}")
        _check_tables(folder, scenario, tick, instead)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        probe = folder / ".orchard"
        probe.touch()
        probe.unlink()
    except OSError as error:
        raise OSError(f"{folder}: tables cannot be written there: {error.strerror}{instead}") from error


def _check_tables(folder: Path, scenario: Scenario, tick: int, instead: str) -> None:
    try:
        file = files_of(path_of(folder, "bodies"))[-1]
        told = (pq.read_schema(file).metadata or {}).get(SCENARIO, b"{}")
        last = last_tick(folder)
    except (pa.ArrowException, OSError) as error:
        raise ValueError(f"{folder}: the tables there cannot be read: {error}{instead}") from error
    if msgspec.json.decode(told) != msgspec.json.decode(scenario.model_dump_json()):
        raise ValueError(f"{folder}: the tables there are of another scenario{instead}")
    if last != tick and path_of(folder, "summary").exists():
        raise ValueError(
            f"{folder}: the tables there are of a run that ended at tick {last}, and this one goes on at tick {tick}: "
            f"its rows would be lost{instead}"
        )
    if last < tick:
        raise ValueError(
            f"{folder}: the tables there end at tick {last}, and the run goes on at tick {tick}: rows would be missing{instead}"
        )


def last_tick(folder: Path) -> int:
    """Return the last tick with rows; 0 if there is none. Raises OSError or ArrowException if it cannot be read."""
    files = files_of(path_of(folder, "bodies"))
    ticks = pq.read_table(files[-1], columns=["tick"])["tick"] if files else []
    return int(ticks[-1].as_py()) if len(ticks) else 0
