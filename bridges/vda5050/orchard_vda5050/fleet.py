"""The vehicles of a run: `vehicles(layout, names)`, for which a host process asks."""

import os
from collections.abc import Callable, Collection, Mapping
from functools import cache

from orchard import Agent, Layout
from orchard.contract.guard import Guard
from orchard.dispatch.policies import POLICIES
from orchard.field.kinds import DISPATCH, kind_of
from orchard.field.machines import Machine
from orchard.plans.routes import ROUTES, route_of
from orchard.roads.pickers import graphs_of
from orchard_vda5050.calls import Calls
from orchard_vda5050.carriers import CarrierVehicle
from orchard_vda5050.desk import FleetDesk
from orchard_vda5050.line import Broker, Line, Notices, broker_at
from orchard_vda5050.messages import connection_of, factsheet_of
from orchard_vda5050.network import Network
from orchard_vda5050.pickers import PickerVehicle
from orchard_vda5050.vehicle import Port, Timing

VEHICLES: Mapping[str, type[CarrierVehicle | PickerVehicle]] = {
    "carrier": CarrierVehicle,
    "picker": PickerVehicle,
}
# The settings of `vehicles` are in the environment: this, and a name in capitals.
ENVIRONMENT = "ORCHARD_VDA5050_"
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
    return broker_at(
        setting("broker"), setting("interface"), setting("manufacturer"), setting("version")
    )


def timing() -> Timing:
    """Return the times of the settings. Raises ValueError for one that is no number of seconds."""
    try:
        times = Timing(
            state=float(setting("state")),
            visualization=float(setting("visualization")),
            patience=float(setting("patience")),
        )
    except ValueError as error:
        raise ValueError(f"a time must be a number of seconds: {error}") from None
    if not (times.state >= 0.1 and times.visualization >= 0.0 and times.patience > 0.0):
        raise ValueError(f"{times}: states need at least 0.1 s, and patience more than 0")
    return times


class Lines:
    """The lines of all vehicles to one broker. A run that is reset keeps them."""

    def __init__(self) -> None:
        """Raises ValueError for a broker that cannot be."""
        self._broker = broker()
        self._lines = dict[str, Line]()
        self._network = Network()
        self.notices = Notices(self._network, self._broker)

    def of(self, name: str, machine: Machine) -> Line:
        """Return the line of a vehicle, which is opened when it is first asked for.

        `machine`: what the vehicle can.
        """
        if name not in self._lines:
            greets = [
                ("connection", connection_of("ONLINE")),
                ("factsheet", factsheet_of(kind_of(name), machine, timing().state)),
            ]
            self._lines[name] = Line(
                self._network, self._broker, name, ("order", "instantActions"), greets
            )
        return self._lines[name]

    def close(self) -> None:
        """Say of all vehicles that they go offline, and close their lines."""
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
    others = [name for name in names if kind_of(name) not in (*VEHICLES, DISPATCH)]
    if others:
        raise ValueError(f"{', '.join(others)}: only carriers and pickers are vehicles")
    if "picker" in map(kind_of, names) and route_of(layout).has_zones:
        raise ValueError(
            f"row_width {layout.scenario.row_width:g}: fleet control drives pickers in rows that"
            " are 5.3 m apart or more, so row_width must be 4.8 or more"
        )
    if "carrier" in map(kind_of, names) and layout.scenario.load_out.is_of_carriers:
        raise ValueError(
            "load_out: fleet control knows no way from the bay to a load-out; leave load_out out,"
            " or the carriers to the run"
        )
    if "carrier" in map(kind_of, names) and layout.scenario.bays > 1:
        raise ValueError(
            f"bays {layout.scenario.bays}: fleet control knows one place at the bay; leave bays"
            " out, or the carriers to the run"
        )
    is_dispatch_elsewhere = DISPATCH in layout.agents and DISPATCH not in names
    if is_dispatch_elsewhere and "carrier" in map(kind_of, names):
        raise ValueError(
            f"dispatch {layout.scenario.dispatch}: fleet control sends the carriers;"
            " start the run with --without dispatch, or with --dispatch nearest"
        )
    all_lines = lines()
    calls = Calls(all_lines.notices.tell)

    def line_of(name: str) -> Line:
        """Return the line of a vehicle."""
        return all_lines.of(name, layout.machines[kind_of(name)])

    agents = agents_of(layout, names, line_of, calls, timing())
    # Agents with classes of the user are checked at each tick. All others are checked by tests.
    is_built_in = layout.scenario.dispatch in POLICIES and layout.scenario.route in ROUTES
    return {
        name: Guard(name, agent, layout.agents, trusted=is_built_in)
        for name, agent in agents.items()
    }


def agents_of(
    layout: Layout,
    names: Collection[str],
    port_of: Callable[[str], Port],
    calls: Calls,
    times: Timing,
) -> dict[str, Agent]:
    """Return an agent for each of these names.

    That is a vehicle, or for `dispatch` the one that tells fleet control which bins wait.
    `port_of`: gives the line of a vehicle.
    """
    graphs = {graph.kind: graph for graph in graphs_of(layout)}
    agents: dict[str, Agent] = {}
    if DISPATCH in names:
        agents[DISPATCH] = FleetDesk(layout, DISPATCH, calls)
    for name in names:
        if name != DISPATCH:
            kind = kind_of(name)
            agents[name] = VEHICLES[kind](
                layout, name, graph=graphs[kind], port=port_of(name), calls=calls, timing=times
            )
    return agents
