"""The long-run rate of a harvest in closed form, from geometry and speeds alone. docs/bounds.md derives it.

Times in seconds, rates in bins per second. The form holds for the policy and the route of the scenario.
"""

from collections.abc import Iterable
from functools import cached_property
from statistics import fmean

from orchard.agents.dispatch import dispatch_of, is_early
from orchard.agents.routes import route_of
from orchard.agents.steps import Unload
from orchard.field.layout import UNLOADING_SECONDS, Layout
from orchard.report.delays import TrafficDelays, trip
from orchard.report.exchange import Exchange, exchanges, handling

TRAIN = 3.3 + 0.8  # m: a carrier with its bin, and the gap to the next one; at 1 m/s also the s in which the next one moves into the bay
HALVINGS = 40  # of the range in which the rate is looked for
ROUNDS = 2  # times that a picker picks its rows in the means: after two rounds each row has been left at the same ends again


class Bounds:
    """The terms of the closed form for one orchard, and the long-run rate that follows: each picker picks its rows again and again."""

    def __init__(self, layout: Layout) -> None:
        scenario, route, self._early = layout.scenario, route_of(layout), is_early(dispatch_of(layout))
        self.pickers, self.carriers = scenario.pickers, scenario.carrier_count
        shares: dict[Exchange, float] = {}  # of all bins: each picker delivers as many as another
        for some in [exchanges(route, block, ROUNDS) for block in layout.blocks.values()]:
            for one in some:
                shares[one] = shares.get(one, 0.0) + 1.0 / (len(some) * self.pickers)
        self._each, self._shares = list(shares), list(shares.values())
        self.row_seconds = self._mean(one.picking for one in self._each)  # T, to pick one row
        self.crossing_seconds = self._mean(one.leaving + one.going_on for one in self._each)  # t_x, to leave a full bin and to go on
        self.wait_seconds = self._mean(one.wait(self._early) for one in self._each)  # w, from the full bin to an empty one
        self.cycle_seconds = self._mean(one.cycle for one in self._each)  # C, from the queue's head around the orchard and back
        self.bay_seconds = UNLOADING_SECONDS + handling([Unload()]) + TRAIN  # t_bay, for which one carrier occupies the bay
        trips = [trip(route, one.lane, one.next_lane, one.side, one.approach, self.bay_seconds) for one in self._each]
        self._delays = TrafficDelays(trips, self._shares, self.carriers)

    def _mean(self, values: Iterable[float]) -> float:
        """The mean over the bins of the harvest."""
        return fmean(values, self._shares)

    @cached_property
    def terms(self) -> dict[str, float]:
        """Bins per second that each part of the harvest allows in the long run, with the waits of the rate that all allow together."""
        most, least = min(self.terms_at(0.0).values()), 0.0
        for _ in range(HALVINGS):
            rate = (least + most) / 2.0
            least, most = (rate, most) if min(self.terms_at(rate).values()) > rate else (least, rate)
        return self.terms_at(most)

    def terms_at(self, rate: float) -> dict[str, float]:
        """Return the bins per second that each part allows, if robots wait for others as often as at a rate, bins/s."""
        out, home, crossing = self._delays.at(rate).T.tolist()
        wait = self._mean(one.wait(self._early, delay) for one, delay in zip(self._each, out, strict=True))
        pickers = self.row_seconds + self.crossing_seconds + wait + self._mean(crossing)
        carriers = self.cycle_seconds + self._mean(out) + self._mean(home)
        return {"pickers": self.pickers / pickers, "carriers": self.carriers / carriers, "unloading": 1.0 / self.bay_seconds}

    @property
    def bottleneck(self) -> str:
        """The name of the part that allows least in the long run."""
        return min(self.terms, key=lambda name: self.terms[name])

    @property
    def bins_per_hour(self) -> float:
        """The long-run rate, bins per hour."""
        return 3600.0 * min(self.terms.values())
