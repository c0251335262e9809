"""The options of `orchard calibrate`."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from typer import Argument, BadParameter

from orchard.terminal.options import number, option, scenario_file

LEAST_CONFIDENCE = 0.5
MOST_CONFIDENCE = 0.999
_LOG = "CSV with the columns time, event, and picker or row; carrier if it is known."
_ON = "A scenario of the orchard, with all that the log does not tell: a file, or a name."
_OUT = "Write the scenario to this file."
_CONFIDENCE = "Confidence of all intervals."
LogPath = Annotated[Path, Argument(metavar="LOG.csv", help=_LOG, show_default=False)]


def _confidence(text: str) -> float:
    """Return a share of a text: "0.95" or "95%". Raises BadParameter."""
    if text.endswith("%"):
        share = number(text[:-1]) / 100.0
    else:
        share = number(text)
    if not LEAST_CONFIDENCE <= share <= MOST_CONFIDENCE:
        raise BadParameter(
            f"{text}: expected a share from {LEAST_CONFIDENCE:g} to {MOST_CONFIDENCE:g}, such as"
            " 0.95 or 95%"
        )
    return share


@dataclass(frozen=True, kw_only=True)
class CalibrationOptions:
    """The options of `calibrate`."""

    log: LogPath
    on: Path | None = option(None, _ON, "SCENARIO.yaml", callback=scenario_file)
    out: Path | None = option(None, _OUT, "SCENARIO.yaml")
    confidence: float = option(None, _CONFIDENCE, "SHARE", default="0.95", parser=_confidence)
