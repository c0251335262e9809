"""Run after run, until the time is over; each is judged, and the log of one that is not good is kept."""

import time
from collections.abc import Callable, Iterable

from chaos.harvest import ROOT, Harvest
from chaos.ordeal import undergo
from chaos.place import Place
from chaos.schedule import Trial, trial
from chaos.undisturbed import Result, Undisturbed, scenario
from chaos.verdict import Verdict, verdict
from orchard.field.scenario import TIME_STEP

Say = Callable[[str], None]


def soak(seed: int, numbers: Iterable[int], seconds: float, show: Callable[[float, str], None], say: Say) -> list[Verdict]:
    """These runs, but none begins after so many seconds. `show` is told how far it is; `say` a line for each run."""
    undisturbed, begun, verdicts = Undisturbed(), time.monotonic(), []
    for number in numbers:
        if (gone := time.monotonic() - begun) >= seconds:
            break
        this = trial(seed, number)
        show(gone, str(this))
        verdicts.append(_tried(this, _wanted(this, undisturbed), say))
    return verdicts


def _wanted(this: Trial, undisturbed: Undisturbed) -> Result | None:
    """What the run must come to; None in realtime."""
    if this.mode == "realtime":
        return None
    return undisturbed.result(this.orchard, None if this.seconds is None else round(this.seconds / TIME_STEP))


def _tried(this: Trial, wanted: Result | None, say: Say) -> Verdict:
    with Place(this.is_routed) as place:
        harvest = Harvest([*_words(this), *place.words], f"seed-{this.seed}-run-{this.number}")
        with harvest:
            course = undergo(this, harvest, place)
    found = verdict(this, course, harvest.summary(), wanted)
    say(f"{this}: {'; '.join(found.complaints) or 'good'}")
    if found.complaints:
        say(f"  again: python -m chaos --seed {this.seed} --only {this.number}; its log: {harvest.log.relative_to(ROOT)}")
    else:
        harvest.tidy()
    return found


def _words(this: Trial) -> list[str]:
    """What run.py is told."""
    rows = scenario(this.orchard).rows
    words = ["--rows", str(rows), "--seed", str(this.orchard), "--mode", this.mode, "--speed", this.speed, "--hosts", this.hosts]
    words += [] if this.seconds is None else ["--duration", str(this.seconds)]
    return words + ([] if this.is_recorded else ["--record", "none"])
