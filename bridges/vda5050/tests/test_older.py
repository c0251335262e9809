"""The versions 2.0 and 2.1 of VDA 5050, into which the bridge translates what it sends.

The messages of 2.1 are valid by the standard's own JSON schemas, as the package vda5050-sdk of
others has them, and its fleet control understands them.
"""

import asyncio
import json
from itertools import pairwise

from orchard_vda5050.messages import connection_of, factsheet_of
from orchard_vda5050.older import older, oldest
from orchards import HEADER, SMALL, Fleet
from test_faults import begun
from vda5050.client.master.client import MasterClient
from vda5050.config import MasterConfig
from vda5050.domain.order.builder import OrderBuilder
from vda5050.testing.memory_transport import MemoryBroker, MemoryTransport
from vda5050.validation.schema_validator import SchemaValidator

from orchard.field.layout import lay_out
from orchard.field.scenario import Scenario

NAME = "carrier_01"
# The fields of the header, which a bridge adds last.
HEAD = ("headerId", "timestamp", "version", "manufacturer", "serialNumber")


def in_21(topic, message):
    """A message with its header, in version 2.1."""
    head = {key: message.get(key, 0) for key in HEAD} | {"version": "2.1.0"}
    body = {key: value for key, value in message.items() if key not in HEAD}
    return head | older(topic, body)


def test_all_messages_are_valid_by_the_schemas_of_2_1():
    fleet, name = begun(released=1)
    fleet.master.instant(name, "fly")
    fleet.master.instant(name, "startPause")
    fleet.until(lambda: fleet.state(name)["paused"])
    sent = [(topic, message) for _, topic, message in fleet.heard]
    head = HEADER | {"serialNumber": name}
    for connection_state in ("ONLINE", "OFFLINE", "CONNECTION_BROKEN"):
        sent.append(("connection", head | connection_of(connection_state)))
    machines = lay_out(Scenario()).machines
    for kind in ("carrier", "picker"):
        sent.append(("factsheet", head | factsheet_of(kind, machines[kind], 1.0)))
    for topic, message in sent:
        assert SchemaValidator().errors(topic, in_21(topic, message)) == []


def test_a_state_of_2_0_has_no_maps_and_no_positions_of_nodes():
    """In version 2.0 the position of a node needs an angle, which an order does not say."""
    fleet, name = begun()
    state = fleet.state(name)
    assert state["maps"]
    assert state["nodeStates"][0]["nodePosition"]
    in_20 = oldest("state", state)
    assert "maps" not in in_20
    assert len(in_20["nodeStates"]) == len(state["nodeStates"])
    for node in in_20["nodeStates"]:
        assert set(node) == {"nodeId", "sequenceId", "released"}
    assert in_20["agvPosition"] == older("state", state)["agvPosition"]


def test_a_fleet_control_of_others_drives_a_vehicle():
    """A fleet control of others drives a vehicle and releases more of the way."""
    assert asyncio.run(drive_to_a_stop()) == "east/stop/1"


async def drive_to_a_stop():
    """Drive a vehicle to a stop by vda5050-sdk, in two parts. Return where it stands then."""
    fleet = Fleet(SMALL)
    fleet.has_master = False
    wires = MemoryBroker()
    here = MemoryTransport(wires)
    master = MasterClient(MasterConfig(validate_messages=True), transport=MemoryTransport(wires))

    async def arrived(topic, payload):
        fleet.wires[NAME].inbox.append((topic.rsplit("/", 1)[1], payload))

    async def until(condition):
        """Tick, and pass messages on to the master, until a state fulfils the condition."""
        for _ in range(2000):
            passed_on = len(fleet.heard)
            fleet.tick()
            for name, topic, message in fleet.heard[passed_on:]:
                payload = json.dumps(in_21(topic, message)).encode()
                await here.publish(f"uagv/v2/orchard/{name}/{topic}", payload)
            session = await master.session(key)
            if session.state is not None and condition(session.state):
                return session.state
        raise AssertionError(session.state)

    key = f"orchard/{NAME}"
    await here.subscribe(f"uagv/v2/{key}/order", arrived)
    await master.connect()
    # The first order releases the first two nodes of the way and the edge between them.
    names = fleet.master.way("queue/1", "east/stop/1")
    order = OrderBuilder(order_id="theirs", manufacturer="orchard", serial_number=NAME)
    for number, name in enumerate(names):
        order.add_node(name, released=number < 2)
    for number, (start, end) in enumerate(pairwise(names)):
        order.add_edge(start, end, released=number < 1)
    await until(lambda state: state.last_node_id == "queue/1")
    assert (await master.dispatch(order.build(), key)).accepted
    await until(lambda state: state.last_node_id == names[1] and state.new_base_request)
    more = OrderBuilder.from_order(order.build())
    for start, end in pairwise(names[1:]):
        more.add_node(end).add_edge(start, end)
    assert (await master.dispatch(more.build(), key)).accepted
    state = await until(lambda state: state.last_node_id == names[-1] and not state.driving)
    assert state.errors == []
    assert state.node_states == []
    return state.last_node_id
