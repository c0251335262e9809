"""Recordings of several runs as one dataset of Rerun.

Its viewer lists the runs, and opens each with the views of the orchard. A program reads all of them
as one table.

    pip install 'rerun-sdk[catalog]'              # 115 MB more
    orchard --mode local --carriers 2 --record two.rrd
    orchard --mode local --carriers 3 --record three.rrd
    python examples/compare_recordings.py two.rrd three.rrd
    rerun rerun+http://127.0.0.1:PORT      # in another terminal; the example prints the address

The dataset is on this machine only, until Ctrl-C. Recordings that have several parts, or that are
of one run, cannot be in one dataset.
"""

import argparse
import json
import sys
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from threading import Event

from rerun.catalog import DatasetEntry
from rerun.chunk import RrdReader
from rerun.server import Server

from orchard import lay_out
from orchard.field.scenario import check
from orchard.view.blueprint import blueprint
from orchard.view.reader import SCENARIO, column

NAME = "harvests"  # of the dataset
# The entity of a recording with the number of bins delivered so far, and the column of its values.
DELIVERED = "/metrics/bins/delivered"
VALUES = f"{DELIVERED}:Scalars:scalars"


def views_of(recording: Path, file: Path) -> None:
    """Write the views of a recording's orchard into a file, as a blueprint.

    Raises ValueError if it is no recording of an orchard.
    """
    for chunk in RrdReader(recording).stream():
        if chunk.entity_path == f"/{SCENARIO}":
            text = column(chunk, "TextDocument:text")[0][0]
            scenario = check(json.loads(text), str(recording))
            blueprint(lay_out(scenario)).save("orchard", str(file))
            return
    raise ValueError(f"{recording}: no scenario in it; expected a recording of the orchard")


def delivered(dataset: DatasetEntry) -> dict[str, int]:
    """Return how many bins were delivered in each run: its name -> the last value."""
    # Each recording is a segment of the dataset; its id is that of the run.
    segments = dataset.segment_table().to_pandas().set_index("rerun_segment_id")
    names = segments["property:RecordingInfo:name"]
    rows = dataset.filter_contents(DELIVERED).reader("sim_time").to_pandas()
    values = rows.sort_values("sim_time").dropna(subset=VALUES)
    last = values.groupby("rerun_segment_id").last()[VALUES]
    # A cell is a list of one value.
    return {names[run][0]: int(value[0]) for run, value in last.items()}


def main(recordings: Sequence[str]) -> None:
    with (
        TemporaryDirectory() as folder,
        Server(host="127.0.0.1", datasets={NAME: recordings}) as server,
        suppress(KeyboardInterrupt),
    ):
        dataset = server.client().get_dataset(NAME)
        views = Path(folder) / "views.rbl"
        views_of(Path(recordings[0]), views)
        dataset.register_blueprint(views.as_uri())
        for run, bins in sorted(delivered(dataset).items()):
            print(f"{run}: {bins} bins delivered")
        print("serving", server.url(), flush=True)
        # Nothing sets this event: the server runs until Ctrl-C.
        Event().wait()


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Serve recordings as one dataset of Rerun.")
    parser.add_argument("recordings", nargs="+", metavar="RECORDING.rrd")
    try:
        main(parser.parse_args().recordings)
    except (ValueError, RuntimeError) as error:  # no such file, or not of the orchard
        sys.exit(str(error))
