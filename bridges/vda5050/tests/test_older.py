"""VDA 5050 2.1: valid by the standard's own JSON schemas, as a package of others has them, and
understood by its fleet control.
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


HEAD = ("headerId", "timestamp", "version", "manufacturer", "serialNumber")


def in_21(topic, message):
    """A message with its header."""
    head = {key: message.get(key, 0) for key in HEAD} | {"version": "2.1.0"}
    return head | older(topic, {key: value for key, value in message.items() if key not in HEAD})


def test_all_messages_are_valid_by_the_schemas_of_2_1():
    fleet, name = begun(released=1)
    fleet.master.instant(name, "fly")
    fleet.master.instant(name, "startPause")
    fleet.until(lambda: fleet.state(name)["paused"])
    once = [connection_of("ONLINE"), connection_of("OFFLINE"), connection_of("CONNECTION_BROKEN")]
    head = HEADER | {"serialNumber": name}
    sent = [(topic, message) for _, topic, message in fleet.heard]
    sent += [
        *(
            ("factsheet", head | factsheet_of(kind, lay_out(Scenario()).machines[kind], 1.0))
            for kind in ("carrier", "picker")
        ),
        *(("connection", head | message) for message in once),
    ]
    for topic, message in sent:
        assert SchemaValidator().errors(topic, in_21(topic, message)) == []


def test_a_state_of_2_0_has_no_maps_and_no_positions_of_nodes():
    """Such a position needs an angle in version 2.0. An order does not say it."""
    fleet, name = begun()
    state = fleet.state(name)
    assert state["maps"] and state["nodeStates"][0]["nodePosition"]
    words = oldest("state", state)
    assert "maps" not in words
    assert [set(node) for node in words["nodeStates"]] == [
        {"nodeId", "sequenceId", "released"} for _ in state["nodeStates"]
    ]
    assert words["agvPosition"] == older("state", state)["agvPosition"]


def test_a_fleet_control_of_others_drives_a_vehicle():
    """A fleet control of others drives a vehicle and releases more of the way."""
    assert asyncio.run(driven()) == "east/stop/1"


async def driven():
    """Drive a vehicle to a stop by vda5050-sdk, in two parts. Return where it stands then."""
    fleet, wires = Fleet(SMALL), MemoryBroker()
    fleet.has_master = False
    here = MemoryTransport(wires)
    master = MasterClient(MasterConfig(validate_messages=True), transport=MemoryTransport(wires))

    async def arrived(topic, payload):
        fleet.wires[NAME].inbox.append((topic.rsplit("/", 1)[1], payload))

    async def until(condition):
        for _ in range(2000):
            told = len(fleet.heard)
            fleet.tick()
            for name, topic, message in fleet.heard[told:]:
                await here.publish(
                    f"uagv/v2/orchard/{name}/{topic}", json.dumps(in_21(topic, message)).encode()
                )
            session = await master.session(key)
            if session.state is not None and condition(session.state):
                return session.state
        raise AssertionError(session.state)

    key = f"orchard/{NAME}"
    await here.subscribe(f"uagv/v2/{key}/order", arrived)
    await master.connect()
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
    assert state.errors == [] and state.node_states == []
    return state.last_node_id
