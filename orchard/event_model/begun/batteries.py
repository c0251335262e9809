"""Batteries at a moment: how full they are, and which carriers charge or wait for a charger."""

from math import ceil

from orchard.event_model import codes as c
from orchard.event_model.begun.doing import Doing, NotInPlanError
from orchard.event_model.begun.moment import RunMoment
from orchard.event_model.harvest import EventHarvest
from orchard.field.machines import haul_charge
from orchard.field.scenario import TIME_STEP
from orchard.field.ticks import ROUNDING
from orchard.plans import steps as st

HOUR = 3600.0  # s


class BatteriesOfCarriers:
    """Takes over what carriers have left in their batteries, and which of them have a charger."""

    def __init__(self, moment: RunMoment, harvest: EventHarvest) -> None:
        self._model = harvest.model
        self._tick = moment.tick
        layout = moment.world.layout
        self._index = layout.index
        self._carrier = layout.machines["carrier"]
        self._haul_charge = haul_charge(layout.scenario, self._carrier)
        self._charge = moment.world.charge.tolist()
        self._plugged = moment.world.plugged.tolist()
        self._twist = moment.world.twist
        seconds_to_charge = layout.scenario.carrying.battery.hours_to_charge * HOUR
        self._ticks_to_charge = seconds_to_charge / TIME_STEP

    def take_over(self, me: Doing) -> None:
        """Set the battery of a carrier, and when it is full. Raises NotInPlanError for a flat one.

        A carrier that has come to its charging line charges, or waits there for a charger.
        """
        if me.memory.flat:
            raise NotInPlanError(f"{me.name} stands with a flat battery")
        body = self._index[me.name]
        charge = self._charge[body]
        me.more["charge"] = charge
        me.more["is_charged"] = me.memory.charged or charge >= 1.0
        if isinstance(me.step, st.Haul):
            self._haul_on(me)
        if me.kind == c.TURN and me.alarm is not None:
            # The machine counts a whole turn as moved when it begins (kernel/turns.py). So what is
            # counted here is the rest of the turn. A drive is counted when it ends.
            me.more["moved"] = me.alarm - self._tick
            me.more["moved_at"] = me.alarm
        if self._plugged[body]:
            self._charge_on(me, charge)
        elif waits_in_charging_line(me) and not me.more["is_charged"]:
            self._await_charger(me, has_stood=not self._twist[body].any())

    def _haul_on(self, me: Doing) -> None:
        """Use what the rest of the way to the load-out and back takes, and charge after it.

        Nothing asks for the charge before the carrier is back, so it may be taken off at once.
        """
        # The tick at which it is back (orchard/plans/carrying.py, `Haul`).
        back = me.more["back"]
        # The share of its time away that is still to come.
        rest = (back - self._tick) / self._carrier.haul_ticks
        me.more["charge"] -= rest * self._haul_charge
        if any(isinstance(step, st.Charge) for step in me.memory.plan):
            me.more["is_charged"] = False
            # It asks for a charger when it is back, and has stood for a tick.
            asks = max(self._tick, back) + 1
            self._model.timers[c.PARK, me.number] = c.QUARTERS * asks

    def _charge_on(self, me: Doing, charge: float) -> None:
        """Charge up to the tick at which the battery is full, if the carrier stands until then."""
        self._model.desk.free_chargers -= 1
        me.more["is_charging"] = True
        me.more["parked"] = me.more["stood"]
        # Rounding must not make it a tick more.
        ticks = ceil((1.0 - charge) * self._ticks_to_charge - ROUNDING)
        self._model.timers[c.FULLY_CHARGED, me.number] = c.QUARTERS * (self._tick + ticks)

    def _await_charger(self, me: Doing, has_stood: bool) -> None:
        """Wait for a charger, or look later whether the carrier stands."""
        if has_stood:
            me.more["waits_to_charge"] = True
            me.more["parked"] = me.more["stood"]
        else:
            # By then it has stood for a tick, if it stands in this one.
            self._model.timers[c.PARK, me.number] = c.QUARTERS * (self._tick + 1)


def waits_in_charging_line(me: Doing) -> bool:
    """Whether a carrier has come to its charging line, and has not been called from there."""
    steps = [type(step) for step in me.memory.plan]
    return st.Charged in steps and st.Charge not in steps
