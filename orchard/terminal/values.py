"""Values and times as a user types and reads them."""

import json
import re
from typing import Any

from typer import BadParameter

from orchard.field.scenario import TICKS_PER_SECOND, TIME_STEP

# [[hours:]minutes:]seconds, with at most one decimal, because a tick is 0.1 s.
_MOMENT = re.compile(r"(?:(?:(\d{1,4}):)?(\d{1,6}):)?(\d{1,8}(?:\.\d)?)")


def value_of(text: str) -> Any:
    """Return the number, word or null that a user has typed."""
    try:
        return json.loads(text)
    except (ValueError, RecursionError):
        return text


def clock(tick: int) -> str:
    """Return the simulated time of a tick as a user reads it: 12:00 or 12:00.5."""
    minutes, ticks = divmod(tick, 60 * TICKS_PER_SECOND)
    seconds, tenths = divmod(ticks, TICKS_PER_SECOND)
    shown = f"{minutes}:{seconds:02d}"
    if tenths:
        shown += f".{tenths}"
    return shown


def moment(text: str) -> int:
    """Return the tick of a simulated time, in s or as M:SS or H:MM:SS. Raises BadParameter."""
    parts = _MOMENT.fullmatch(text)
    if parts is None or not _is_time(*parts.groups()):
        raise BadParameter(f"{text}: expected a simulated time, in s or as M:SS or H:MM:SS")
    hours, minutes, seconds = (float(part or 0) for part in parts.groups())
    return round((3600 * hours + 60 * minutes + seconds) / TIME_STEP)


def _is_time(hours: str | None, minutes: str | None, seconds: str) -> bool:
    """Whether a part that follows a larger one is less than 60."""
    return not (minutes and float(seconds) >= 60.0) and not (hours and int(minutes or 0) >= 60)
