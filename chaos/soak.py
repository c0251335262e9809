"""Runs trial after trial until the time is over.

Each run is judged; the log of a run that is not good is kept.
"""

import time
from collections.abc import Callable, Iterable

from chaos.baseline import Baseline, Result, scenario
from chaos.fault_injection import inject_faults
from chaos.harvest import ROOT, Harvest
from chaos.network import Network
from chaos.oracle import Verdict, judge
from chaos.schedule import FULL, Trial, trial
from orchard.field.scenario import TIME_STEP

Say = Callable[[str], None]


def soak(
    seed: int, numbers: Iterable[int], seconds: float, show: Callable[[float, str], None], say: Say
) -> list[Verdict]:
    """Run the trials with these numbers, but begin none after `seconds`. Return their verdicts.

    `show` gets the elapsed seconds and the trial before each run; `say` gets a line after each run.
    """
    baseline = Baseline()
    begun = time.monotonic()
    verdicts = []
    for number in numbers:
        elapsed = time.monotonic() - begun
        if elapsed >= seconds:
            break
        this = trial(seed, number)
        show(elapsed, str(this))
        verdicts.append(_run(this, _expected(this, baseline), say))
    return verdicts


def _expected(this: Trial, baseline: Baseline) -> Result | None:
    """Return the result that the run must reach; None in realtime."""
    if this.mode == "realtime":
        return None
    ticks = None
    if this.seconds is not None:
        ticks = round(this.seconds / TIME_STEP)
    return baseline.result(scenario(this.orchard, this.is_mistaken), ticks)


def _run(this: Trial, expected: Result | None, say: Say) -> Verdict:
    """Do one run with its faults, and judge it."""
    with Network(this.is_routed) as network:
        name = f"seed-{this.seed}-run-{this.number}"
        has_disk = any(fault.kind == FULL for fault in this.faults)
        with Harvest(
            scenario(this.orchard, this.is_mistaken),
            [*_arguments(this), *network.arguments],
            name,
            has_disk,
        ) as harvest:
            if has_disk and not harvest.disk.is_there:
                say(f"{this}: without {FULL!r}, because this machine mounts no disk")
            execution = inject_faults(this, harvest, network)
    verdict = judge(this, execution, harvest.summary(), expected)
    say(f"{this}: {'; '.join(verdict.complaints) or 'good'}")
    if verdict.complaints:
        say(
            f"  to repeat it: python -m chaos --seed {this.seed} --only {this.number}; log:"
            f" {harvest.log.relative_to(ROOT)}"
        )
    else:
        harvest.tidy()
    return verdict


def _arguments(this: Trial) -> list[str]:
    """Return the trial's options of run.py, without the scenario."""
    arguments = ["--mode", this.mode, "--speed", this.speed, "--hosts", this.hosts]
    if this.seconds is not None:
        arguments += ["--duration", str(this.seconds)]
    if not this.is_recorded:
        arguments += ["--record", "none"]
    return arguments
