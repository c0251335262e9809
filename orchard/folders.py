"""The folders in which the program writes for its user: never in the folder where it is installed."""

import os
from pathlib import Path

import platformdirs

RUNS = "ORCHARD_RUNS"  # environment variable: another folder of runs


def runs_folder() -> Path:
    """Return the folder for recordings, snapshots and notes of active runs. It need not exist yet."""
    return Path(os.environ.get(RUNS) or platformdirs.user_data_path("orchard", appauthor=False) / "runs").absolute()
