"""`orchard export`: reads a recording, writes a bag, and says what is in it and what is not."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

from rich.progress import track

from orchard.bags.drives import Drives, RecordingError, read_drives
from orchard.bags.export import chosen, export
from orchard.field.problems import ScenarioError
from orchard.field.scenario import TIME_STEP
from orchard.folders import named
from orchard.terminal.exits import FINISHED, exit_on_errors
from orchard.terminal.output import console, print_error, print_line

HEAD = b"\x89MCAP0\r\n"  # with which each MCAP file begins


def export_bag(recording: Path, file: Path, robots: list[str], with_scans: bool) -> int:
    """Make a bag from a recording. Return the exit code."""
    with exit_on_errors(RecordingError, ScenarioError, OSError, ValueError):
        check_bag(file)
        drives = read_drives(recording, with_scans)
        names = chosen(drives, robots)
        for note in lacks(drives):
            print_error(f"{recording}: {note}")
        with named(file):
            count = export(drives, names, file, _shown)
    print_line(
        f"{file}: {count:,} messages of {', '.join(names)}, {file.stat().st_size / 1e6:.1f} MB"
    )
    return FINISHED


def _shown(ticks: Iterable[Any], count: int) -> Iterable[Any]:
    """Return the ticks, of which a terminal shows how many are done."""
    return track(
        ticks, "exporting", count, console=console, transient=True, disable=not console.is_terminal
    )


def check_bag(file: Path) -> None:
    """Raise ValueError for a file that a bag must not replace, OSError without its directory."""
    if file.suffix != ".mcap":
        raise ValueError(
            f"{file}: expected a name that ends in .mcap, as {file.with_suffix('.mcap')}"
        )
    if not file.parent.is_dir():
        raise OSError(f"{file}: cannot be written: {file.parent} is no directory")
    if file.exists() and not (file.is_file() and file.read_bytes().startswith(HEAD)):
        raise ValueError(f"{file}: this is no bag, and is not replaced; expected another name")


def lacks(drives: Drives) -> list[str]:
    """Return what is not in the recording, and so not in its bag."""
    missing = []
    if drives.first > 1:
        missing.append(f"the recording begins at {drives.first * TIME_STEP:.1f} s")
    for since, until in drives.gaps:
        span = f"from {since * TIME_STEP:.1f} s to {until * TIME_STEP:.1f} s"
        missing.append(f"nothing recorded {span}")
    if drives.is_torn:
        end = f"{drives.last * TIME_STEP:.1f} s"
        missing.append(f"its end is torn off, and it is repaired; it ends at {end}")
    notes = [f"{words}; the bag lacks that, too" for words in missing]
    if drives.left_out:
        notes.append(
            f"{drives.left_out} ticks are not recorded: the poses before them stand for them"
        )
    return notes
