"""A whole harvest in the event model, and what it gives: the door to `orchard.event_model`.

The packages that ask how long a harvest takes (optimum, report, study, gym, futures) use it.
"""

from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import cycle, islice
from math import inf

from orchard.event_model.known import refuse_unknown
from orchard.event_model.results import Exchange
from orchard.field.layout import Layout
from orchard.field.scenario import Scenario


class Jam(RuntimeError):
    """Raised for the figures of a harvest that does not go on: some robots wait for ever, or as
    good as that.
    """


@dataclass(frozen=True)
class DiscreteFigures:
    """What a harvest, or its long run, gives. All figures are of the same time."""

    bins_per_hour: float
    # s for which a picker stands until it has an empty bin, mean of all its bins.
    picker_waiting_seconds: float
    # Share of the time for which a carrier is outside the queue, 0 to 1, mean of all carriers.
    carrier_utilisation: float
    # s, the simulated time to which the figures belong.
    sim_seconds: float
    # Bins that were unloaded in this time.
    bins: int


def get_ready(scenarios: Iterable[Scenario]) -> None:
    """Compile what harvests of these scenarios need, if anything, before several processes would
    each do it.
    """
    if any(map(_is_known, scenarios)):
        from orchard.event_model.kernel import entry

        entry.get_ready()


def _is_known(scenario: Scenario) -> bool:
    """Whether the event model knows the sensors and agents of a scenario."""
    with suppress(ValueError):
        refuse_unknown(scenario)
        return True
    return False


class DiscreteHarvest:
    """One harvest. `run` does it; then `seconds` and `delivered` tell how it went."""

    def __init__(self, layout: Layout, rows_each: int | None = None) -> None:
        """`rows_each`: how many rows each picker picks, its own again and again; None: each of its
        own once.

        Raises ValueError for agents of the user's own, and for sensors that are not exact;
        NotImplementedError for steps that the model does not know.
        """
        refuse_unknown(layout.scenario)
        # It loads numba, which takes a second. A program that does no harvest needs none of it.
        from orchard.event_model.harvest import EventHarvest

        self.layout = layout if rows_each is None else picked_again(layout, rows_each)
        self.model = EventHarvest(self.layout)

    def run(self, goes_on: Callable[[], bool] = lambda: True) -> "DiscreteHarvest":
        """Do the whole harvest, or all until robots wait for each other, or it no longer `goes_on`,
        and return it.
        """
        self.model.run(goes_on)
        return self

    def spread_charges(self) -> None:
        """Let carriers begin with batteries charged differently, as they are after some days, and
        not all full.
        """
        self.model.spread_charges()

    # -- what came of it

    def figures(self) -> DiscreteFigures:
        """Return the figures of the whole harvest. Raises Jam."""
        if not self.is_over:
            raise self.jam()
        return DiscreteFigures(
            bins_per_hour=3600.0 * self.delivered / self.seconds,
            picker_waiting_seconds=self.picker_waiting_seconds(),
            carrier_utilisation=self.carrier_utilisation(),
            sim_seconds=self.seconds,
            bins=self.delivered,
        )

    def jam(self) -> Jam:
        """Return why it did not end."""
        flat = self.model.flat
        why = "some robots wait for ever"
        if flat:
            why = f"the battery of {' and '.join(flat)} is flat"
        return Jam(f"only {self.delivered} bins were delivered: {why}")

    @property
    def bins(self) -> int:
        """The bins that are filled."""
        return self.model.bins

    @property
    def delivered(self) -> int:
        """The bins that were unloaded."""
        return self.model.delivered

    @property
    def deliveries(self) -> list[float]:
        """When each bin was unloaded, s."""
        return self.model.deliveries

    @property
    def is_over(self) -> bool:
        """Whether all bins were delivered, and no battery is flat; if not, robots wait for each
        other.
        """
        return self.model.is_over

    @property
    def seconds(self) -> float:
        """The length of the harvest, s."""
        return self.model.seconds

    @property
    def stood(self) -> dict[str, float]:
        """The time since which each robot stands, s."""
        return self.model.stood

    @property
    def waited_seconds(self) -> float:
        """The time for which all pickers together have had no bin to fill so far, s, drives
        included.
        """
        return self.model.waited_seconds

    def exchange_counts(self, since: float = 0.0) -> dict[str, int]:
        """Return how many empty bins each picker got for full ones, from a time on, s."""
        return self.model.exchange_counts(since)

    @property
    def exchanges(self) -> dict[str, list[Exchange]]:
        """Of each picker, in the order in which it got empty bins for full ones."""
        return self.model.exchanges

    def share_done(self, picker: str) -> float:
        """Return which share of its plan a picker has begun, 0 to 1."""
        return self.model.share_done(picker)

    def picker_waiting_seconds(self, since: float = 0.0, until: float = inf) -> float:
        """Return the mean time for which pickers stood until they got empty bins, s; 0 if they got
        none.

        Of bins that they got between two times. The drive to the place where they stand is no wait.
        """
        return self.model.picker_waiting_seconds(since, until)

    def carrier_utilisation(self, since: float = 0.0, until: float | None = None) -> float:
        """Return the share of the time for which a carrier is outside the queue, 0 to 1, mean over
        the carriers; None: to the end.
        """
        return self.model.carrier_utilisation(since, until)


def picked_again(layout: Layout, rows_each: int) -> Layout:
    """Return a layout in which each picker picks so many rows, its own again and again."""
    blocks = {}
    for name, block in layout.blocks.items():
        blocks[name] = replace(block, rows=tuple(islice(cycle(block.rows), rows_each)))
    return replace(layout, blocks=blocks)
