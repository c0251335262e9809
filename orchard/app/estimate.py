"""What the fleet of the form would do: harvests of the event model, more while one looks."""

from collections.abc import Sequence
from dataclasses import dataclass, field

from nicegui import run, ui

from orchard.behaviour.dispatcher import PolicyFault
from orchard.discrete.harvest import DiscreteHarvest, Jam
from orchard.field.layout import lay_out
from orchard.field.problems import ScenarioError
from orchard.field.scenario import Scenario, with_changes
from orchard.report.limits import full_bins
from orchard.report.summary import clock
from orchard.study.comparing import interval
from orchard.study.words import counted, interval_words

# Harvests of one scenario, at most.
MOST_HARVESTS = 40
# After so many harvests the estimate is done if half of the interval of the mean is at most SURE of
# the mean.
FEWEST_HARVESTS = 4
SURE = 0.005
# Of that interval.
CONFIDENCE = 0.95
# Between two looks whether there is more to estimate, s.
LOOK_SECONDS = 0.1


@dataclass(frozen=True)
class FastHarvest:
    """One harvest: full bins an hour, as a run and a study count them, and its length, s.

    `fault`: why there is none, in words.
    """

    bins_per_hour: float = 0.0
    seconds: float = 0.0
    fault: str = ""


def harvest(scenario: Scenario, number: int) -> FastHarvest:
    """Do a harvest of the event model. `number`: of the harvest, from 0; each has its own seed."""
    try:
        # The seeds after that of the scenario. A seed is less than 2**63.
        layout = lay_out(with_changes(scenario, seed=(scenario.seed + number) % 2**63))
        figures = DiscreteHarvest(layout).run().figures()
    except (Jam, PolicyFault, ScenarioError, ValueError, NotImplementedError) as error:
        return FastHarvest(fault=str(error))
    # The last bin of a row may be part full.
    return FastHarvest(3600.0 * full_bins(layout) / figures.sim_seconds, figures.sim_seconds)


@dataclass
class FleetEstimate:
    """The harvests of one scenario so far."""

    scenario: Scenario
    samples: list[FastHarvest] = field(default_factory=list)

    @property
    def is_done(self) -> bool:
        """Whether more harvests would tell nothing new, or nothing that matters."""
        if not self.samples:
            return False
        if self.samples[-1].fault or len(self.samples) >= MOST_HARVESTS:
            return True
        return len(self.samples) >= FEWEST_HARVESTS and self.unsure <= SURE

    @property
    def unsure(self) -> float:
        """How unsure the mean is, as a share of it: half of its interval; 1 if nothing is known."""
        if len(self.samples) < 2:
            return 1.0
        known = interval(self._rates(), CONFIDENCE)
        return min(1.0, (known.high - known.mean) / known.mean)

    def words(self) -> str:
        """Return what is known so far, in a sentence."""
        carriers = counted("carriers", self.scenario.carrier_count)
        if not self.samples:
            return f"With {carriers}: the first harvest is computed."
        fault = self.samples[-1].fault
        if fault:
            return f"With {carriers}: no estimate, because {fault}"
        rate = interval_words(interval(self._rates(), CONFIDENCE))
        seconds = sum(sample.seconds for sample in self.samples) / len(self.samples)
        harvests = _harvests_words(self.samples)
        return (
            f"With {carriers}: {rate} bins an hour, the harvest in {clock(seconds)} ({harvests})."
        )

    def _rates(self) -> list[float]:
        return [sample.bins_per_hour for sample in self.samples]


def _harvests_words(samples: Sequence[FastHarvest]) -> str:
    """Return how sure a figure is, by the harvests that it comes from."""
    if len(samples) == 1:
        return "one harvest; more are computed"
    return f"{len(samples)} harvests, {CONFIDENCE:.0%} sure of the mean"


class EstimateView:
    """The estimate in words, and a bar of what is still unsure, which shrinks while one looks."""

    def __init__(self) -> None:
        with ui.element("div").props("data-view=estimate"):
            self._words = ui.label()
            self._bar = ui.linear_progress(value=1.0, show_value=False, size="6px")
            self._bar.props('rounded instant-feedback aria-label="How unsure the estimate is"')
        self._estimate: FleetEstimate | None = None
        self._is_busy = False
        ui.timer(LOOK_SECONDS, self._go_on)

    def show(self, scenario: Scenario | None) -> None:
        """Estimate another scenario from now on. None: what is entered is invalid."""
        if scenario is None:
            self._estimate = None
            self._words.set_text("")
            self._bar.set_visibility(False)
        elif self._estimate is None or self._estimate.scenario != scenario:
            self._estimate = FleetEstimate(scenario)
            self._draw(self._estimate)

    async def _go_on(self) -> None:
        """Do the next harvest in another process, and show what it adds."""
        estimate = self._estimate
        if self._is_busy or estimate is None or estimate.is_done:
            return
        self._is_busy = True
        try:
            sample = await run.cpu_bound(harvest, estimate.scenario, len(estimate.samples))
        finally:
            self._is_busy = False
        # The server gives None while it shuts down.
        if sample is None or estimate is not self._estimate:
            return
        estimate.samples.append(sample)
        self._draw(estimate)

    def _draw(self, estimate: FleetEstimate) -> None:
        self._words.set_text(estimate.words())
        self._bar.set_value(estimate.unsure)
        self._bar.set_visibility(not estimate.is_done)
