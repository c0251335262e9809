"""The vehicles of a run, as a host process of the Orchard asks for them: `vehicles(layout,
names)`.
"""

import os
from collections.abc import Callable, Collection, Mapping
from functools import cache

from orchard import Agent, Layout
from orchard.contract.guard import Guard
from orchard.dispatch.policies import POLICIES
from orchard.field.kinds import DISPATCH, kind_of
from orchard.plans.routes import ROUTES
from orchard.roads.pickers import graphs_of
from orchard_vda5050.calls import Calls
from orchard_vda5050.carriers import CarrierVehicle
from orchard_vda5050.desk import Desk
from orchard_vda5050.line import Broker, Line, Notices, broker_at
from orchard_vda5050.messages import connection_of, factsheet_of
from orchard_vda5050.network import Network
from orchard_vda5050.pickers import PickerVehicle
from orchard_vda5050.vehicle import Port, Timing

VEHICLES: Mapping[str, type[CarrierVehicle | PickerVehicle]] = {
    "carrier": CarrierVehicle,
    "picker": PickerVehicle,
}
ENVIRONMENT = "ORCHARD_VDA5050_"  # and a name in capitals: the settings of `vehicles`
DEFAULTS: Mapping[str, str | float] = {
    "broker": "mqtt://127.0.0.1:1883",
    "interface": "vda5050",
    "manufacturer": "orchard",
    "version": "3.0.0",
    "state": 1.0,
    "visualization": 0.0,
    "patience": 300.0,
}


def setting(name: str) -> str:
    """Return a setting: from the environment, or its default."""
    return os.environ.get(ENVIRONMENT + name.upper(), str(DEFAULTS[name]))


def broker() -> Broker:
    """Return the broker of the settings. Raises ValueError for one that cannot be."""
    return broker_at(*map(setting, ("broker", "interface", "manufacturer", "version")))


def timing() -> Timing:
    """Return the times of the settings. Raises ValueError for one that is no number of seconds."""
    try:
        times = Timing(*(float(setting(name)) for name in ("state", "visualization", "patience")))
    except ValueError as error:
        raise ValueError(f"a time must be a number of seconds: {error}") from None
    if not (times.state >= 0.1 and times.visualization >= 0.0 and times.patience > 0.0):
        raise ValueError(f"{times}: states need at least 0.1 s, and patience more than 0")
    return times


class Lines:
    """The lines of all vehicles to one broker. A run that is reset keeps them."""

    def __init__(self) -> None:
        self._broker, self._lines = broker(), dict[str, Line]()
        self._network = Network()
        self.notices = Notices(self._network, self._broker)

    def of(self, name: str) -> Line:
        """Return the line of a vehicle, which is opened when it is first asked for."""
        if name not in self._lines:
            greets = [
                ("connection", connection_of("ONLINE")),
                ("factsheet", factsheet_of(kind_of(name), timing().state)),
            ]
            self._lines[name] = Line(
                self._network, self._broker, name, ("order", "instantActions"), greets
            )
        return self._lines[name]

    def close(self) -> None:
        for line in self._lines.values():
            line.leave()
        self._network.close()


@cache
def lines() -> Lines:
    """Return the lines of this process."""
    return Lines()


def vehicles(layout: Layout, names: Collection[str]) -> dict[str, Agent]:
    """Return an agent for each of these names, with a line to fleet control.

    Raises ValueError for what cannot be a vehicle.
    """
    if wrong := [name for name in names if kind_of(name) not in (*VEHICLES, DISPATCH)]:
        raise ValueError(f"{', '.join(wrong)}: only carriers and pickers are vehicles")
    if DISPATCH in layout.agents and DISPATCH not in names and "carrier" in map(kind_of, names):
        why = (
            "fleet control sends the carriers; start the run with --without dispatch, or with"
            " --dispatch nearest"
        )
        raise ValueError(f"dispatch {layout.scenario.dispatch}: {why}")
    agents = agents_of(
        layout, names, lambda name: lines().of(name), Calls(lines().notices.tell), timing()
    )
    are_ours = (
        layout.scenario.dispatch in POLICIES and layout.scenario.route in ROUTES
    )  # the tests of the bridge check its agents
    return {
        name: Guard(name, agent, layout.agents, trusted=are_ours) for name, agent in agents.items()
    }


def agents_of(
    layout: Layout,
    names: Collection[str],
    port_of: Callable[[str], Port],
    calls: Calls,
    times: Timing,
) -> dict[str, Agent]:
    """Return an agent for each of these names: a vehicle, or for `dispatch` the one that tells
    fleet control which bins wait.
    """
    graphs = {graph.kind: graph for graph in graphs_of(layout)}
    desk = {name: Desk(layout, name, calls) for name in names if name == DISPATCH}
    driven = [name for name in names if name not in desk]
    return desk | {
        name: VEHICLES[kind_of(name)](
            layout, name, graphs[kind_of(name)], port_of(name), calls, times
        )
        for name in driven
    }
