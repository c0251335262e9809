"""Policies in Python: each is asked as the dispatcher asks it, and its orders are checked.

The machine stops where one must decide. `PolicyQuestions` reads from the model what the policy is
told, and writes its orders there; then the machine goes on.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from operator import itemgetter
from typing import Any

import numpy as np

from orchard.behaviour.dispatcher import PolicyFault, checked, fault_of
from orchard.contract.messages import pack, unpack
from orchard.dispatch.kept_memory import as_kept
from orchard.dispatch.policies import POLICIES, dispatch_of
from orchard.dispatch.policy import Assignment, BinReport, CarrierReport, is_early
from orchard.event_model import codes as c
from orchard.event_model import columns
from orchard.event_model.picker_plans import SIDES
from orchard.field.kinds import kind_of
from orchard.field.layout import Layout
from orchard.field.plugins import MISTAKES, contained, reraise_ctrl_c

# Columns of a call and of a robot that a policy is told.
OF_BINS = ("is_asked", "bin", "end", "since", "seconds")
OF_CARRIERS = ("is_told", "told_job", "is_ready", "metres_to_head")


class AskedPolicy:
    """The policy of a scenario, with its memory."""

    def __init__(self, layout: Layout) -> None:
        """Raises ScenarioError if the policy cannot be used."""
        self._layout = layout
        self.policy = dispatch_of(layout)
        self.memory = self.policy.Memory()
        self.is_early = is_early(self.policy)
        self.is_built_in = type(self.policy) in POLICIES.values()
        # Built-in early policies order nothing unless a carrier can leave for a bin that is due.
        # Up to then the machine remembers for them when bins are full.
        self.decides_when_due = self.is_built_in and self.is_early
        self._name = layout.scenario.dispatch

    def __getstate__(self) -> dict[str, Any]:
        """Return what a copy needs: what the policy remembers is all that it may change."""
        return {"layout": self._layout, "memory": pack(self.memory)}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Be a copy, with a policy of the same class."""
        AskedPolicy.__init__(self, state["layout"])
        self.memory = unpack(state["memory"], self.policy.Memory)

    def orders(
        self, now: int, bins: Sequence[BinReport], carriers: Sequence[CarrierReport]
    ) -> list[Assignment]:
        """Return what the policy decides at a tick. Raises PolicyFault."""
        try:
            orders = checked(
                contained(self.policy.assign, now, list(bins), list(carriers), self.memory),
                list(bins),
                list(carriers),
            )
            # What a user's policy remembers must be what a dispatcher would keep.
            if not self.is_built_in:
                self.memory = unpack(as_kept(self.memory, self.policy), self.policy.Memory)
        except MISTAKES as error:
            reraise_ctrl_c(error)
            raise PolicyFault(fault_of(self.policy, self._name, error, now)) from error
        return orders


@dataclass
class PolicyQuestion:
    """A decision: what a policy is told, and the numbers of the robots that it is about."""

    #: The tick.
    now: int
    bins: list[BinReport]
    carriers: list[CarrierReport]
    #: Name of a bin -> the number of its picker.
    pickers: dict[str, int]
    #: Name of a carrier -> its number.
    numbers: dict[str, int]

    @property
    def is_open(self) -> bool:
        """Whether a carrier can be sent to a bin."""
        return bool(self.bins) and any(carrier.is_next for carrier in self.carriers)


class PolicyQuestions:
    """The decisions at which the machine stops for a policy in Python."""

    def __init__(self, model: columns.Model, names: list[str], bin_names: list[str]) -> None:
        """`names`, `bin_names`: of robots and bins, in the order of their numbers."""
        self._names = names
        self._bin_names = bin_names
        self._carriers = []
        for number, name in enumerate(names):
            if kind_of(name) == "carrier":
                self._carriers.append(number)
        self._desk = _columns(model.desk, ["now", "state"])
        self._calls = _columns(model.calls, [*OF_BINS, "carrier"])
        self._full = _columns(model.bins, ["full"])["full"]
        self._robots = _columns(model.robots, OF_CARRIERS)
        # Of each lane's end: lane, side, m and s from the queue's head.
        self._ends = []
        for number, end in enumerate(model.ends):
            lane, side = divmod(number, 2)
            self._ends.append((lane + 1, SIDES[side], float(end.metres), float(end.seconds)))

    def read(self) -> PolicyQuestion:
        """Return the decision at which the machine has stopped."""
        bins = self._bins()
        carriers = self._carrier_reports()
        return PolicyQuestion(
            now=int(self._desk["now"][0]) // c.QUARTERS,
            bins=[report for _, report in bins],
            carriers=[report for _, report in carriers],
            pickers={report.name: picker for picker, report in bins},
            numbers={report.name: carrier for carrier, report in carriers},
        )

    def full(self) -> dict[str, int]:
        """Return the tick at which each bin that waits will be full, or was, if that is known."""
        rows = zip(self._calls["is_asked"].tolist(), self._calls["bin"].tolist(), strict=True)
        ticks = {}
        for is_asked, number in rows:
            if is_asked and self._full[number] != c.NONE:
                ticks[self._bin_names[number]] = int(self._full[number])
        return ticks

    def note(self, decision: PolicyQuestion, orders: Sequence[Assignment]) -> None:
        """Note the orders of a decision. The machine carries them out when it goes on."""
        # Until here `is_asked` marked the bins that the policy decided on. From here on it marks
        # those that get a carrier.
        self._calls["is_asked"][:] = False
        for order in orders:
            picker = decision.pickers[order.bin]
            self._calls["is_asked"][picker] = True
            self._calls["carrier"][picker] = decision.numbers[order.carrier]
        self._desk["state"][0] = c.DECIDED

    def _bins(self) -> list[tuple[int, BinReport]]:
        """Return the picker and the report of each bin that waits, by the bins' names."""
        rows = zip(*(self._calls[name].tolist() for name in OF_BINS), strict=True)
        reports = []
        for picker, (is_asked, number, end, since, seconds) in enumerate(rows):
            if is_asked:
                lane, side, metres, reach = self._ends[end]
                report = BinReport(
                    name=self._bin_names[number],
                    lane=lane,
                    side=side,
                    picker=self._names[picker],
                    since=since,
                    metres=metres,
                    seconds_to_full=seconds,
                    seconds_to_reach=reach,
                )
                reports.append((number, picker, report))
        return [(picker, report) for _, picker, report in sorted(reports, key=itemgetter(0))]

    def _carrier_reports(self) -> list[tuple[int, CarrierReport]]:
        """Return the number and the report of each carrier of which the dispatcher knows."""
        rows = [*zip(*(self._robots[name].tolist() for name in OF_CARRIERS), strict=True)]
        reports = []
        for carrier in self._carriers:
            is_told, number, is_ready, metres = rows[carrier]
            if is_told:
                job = "" if number == c.NONE else self._bin_names[number]
                report = CarrierReport(self._names[carrier], job, is_ready, metres)
                reports.append((carrier, report))
        return reports


def _columns(rows: np.ndarray, names: Sequence[str]) -> dict[str, np.ndarray]:
    """Return columns of an array, as views. Through a recarray each look costs a microsecond."""
    plain = rows.view(np.ndarray)
    return {name: plain[name] for name in names}
