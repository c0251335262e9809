"""The files of one recording: NAME.rrd, and after each time that its recorder was away NAME.part2.rrd, NAME.part3.rrd ..."""

import re
from itertools import count, takewhile
from pathlib import Path


def part(path: Path, number: int) -> Path:
    """Where the part of that number is, from 1."""
    return path if number == 1 else path.with_suffix(f".part{number}{path.suffix}")


def is_further_part(path: Path) -> bool:
    """Whether it goes on with what another file begins."""
    return re.search(r"\.part\d+$", path.stem) is not None


def parts_of(path: Path) -> list[Path]:
    """All parts that are there, in their order."""
    return list(takewhile(Path.exists, (part(path, number) for number in count(1))))


def remove_further_parts(path: Path) -> None:
    """Before a new recording takes an old one's place."""
    for old in parts_of(path)[1:]:
        old.unlink()
