"""What the tables of the default harvest cost, with exact sensors and with errors: their processor
time, that of the run, and their size.

    python -m bench.tables
"""

import time
from pathlib import Path
from tempfile import TemporaryDirectory

from orchard.field.scenario import Scenario, with_changes
from orchard.field.shipped import load_or_shipped
from orchard.local import Local
from orchard.tables.tables import Tables

ERRORS = {  # as in docs/reference.md
    "sensors.gnss.white": 0.01,
    "sensors.gnss.bias": 0.02,
    "sensors.odometry.distance": 0.01,
    "sensors.odometry.heading": 0.001,
}
FLUSH_SECONDS = 2.0  # as between two snapshots


def main() -> None:
    """Measure the default harvest, with exact sensors and with errors."""
    scenario = load_or_shipped(None)
    measure("exact sensors", scenario)
    measure("errors", with_changes(scenario, **ERRORS))


def measure(name: str, scenario: Scenario) -> None:
    """Print what the tables of a scenario's harvest cost."""
    with TemporaryDirectory() as folder:
        local = Local(scenario)
        # It loads the compiled kernels, which is not measured.
        local.engine.rehearse()
        # s of processor time: for the tables, and in all; s of wall time: when the next flush is
        # due.
        spent = 0.0
        total = time.process_time()
        due = time.monotonic() + FLUSH_SECONDS
        tables = Tables(Path(folder), local.engine)
        while not local.engine.over:
            events = local.tick()
            begun = time.process_time()
            letters = local.post.written.get(local.engine.tick - 1, {})
            tables.update(local.engine, events, letters)
            if time.monotonic() >= due:
                tables.flush()
                due = time.monotonic() + FLUSH_SECONDS
            spent += time.process_time() - begun
        begun = time.process_time()
        tables.close()
        spent += time.process_time() - begun
        total = time.process_time() - total
        size = sum(
            file.stat().st_size for file in Path(folder).rglob("*.parquet") if file.is_file()
        )
        rows = local.engine.tick * len(local.engine.layout.names)
        print(
            f"{name}: {local.engine.tick} ticks, {rows} rows, {size / 1e6:.2f} MB: {spent:.2f} s"
            f" for the tables, {total - spent:.2f} s for the run"
        )


if __name__ == "__main__":
    main()
