"""Harvests in which a fleet control drives carriers and pickers, in virtual time.

All messages are as the standard has them.
"""

import json
from itertools import groupby

import pytest
from orchard_vda5050.messages import connection_of, factsheet_of
from orchard_vda5050.vehicle import Timing
from orchards import HEADER, SMALL, Fleet
from standard import check

from orchard.field.layout import lay_out
from orchard.field.scenario import Scenario


def checked(fleet):
    """Make the fleet control check its messages as it sends them; `harvest` checks the vehicles'.

    Return the fleet.
    """
    send = fleet.master.send

    def send_checked(name, topic, message):
        check(topic, message)
        send(name, topic, message)

    fleet.master.send = send_checked
    return fleet


def harvest(fleet):
    """Drive the harvest to its end and check the vehicles' messages. Return their collisions."""
    collisions = []
    while not fleet.run.engine.over:
        assert fleet.run.engine.tick < 20_000, [fleet.state(name) for name in fleet.wires]
        for event in fleet.tick():
            if event.what == "collision" and event.who in fleet.wires:
                collisions.append(event)
    for _, topic, message in fleet.heard:
        check(topic, message)
    return collisions


def errors(fleet):
    """The errors in the newest states of all vehicles."""
    return [error for name in fleet.wires for error in fleet.state(name)["errors"]]


@pytest.mark.parametrize(
    ("scenario", "released"),
    [
        (SMALL, 1),
        (SMALL, 99),
        ({"rows": 3, "row_length": 24.0, "carriers": 3, "route": "one-way"}, 4),
        (SMALL | {"dispatch": "predictive"}, 4),
    ],
    ids=str,
)
def test_a_fleet_control_drives_all_carriers_to_the_end(scenario, released):
    """A fleet control drives all carriers until the harvest has finished."""
    fleet = checked(Fleet(scenario, released=released, timing=Timing(visualization=5.0)))
    assert harvest(fleet) == []
    assert errors(fleet) == []
    assert {topic for _, topic, _ in fleet.heard} == {"state", "visualization"}


@pytest.mark.parametrize(
    ("scenario", "names"),
    [
        (SMALL, ["picker", "carrier"]),
        (SMALL | {"dispatch": "predictive", "rows": 5}, ["picker"]),
        (SMALL | {"rows": 5, "rows_to_pickers": "balanced"}, ["picker_02"]),
        (
            {
                "rows": 4,
                "row_length": 24.0,
                "route": "one-way",
                "carriers": 3,
                "metres_per_bin": 48.0,
            },
            ["picker", "carrier"],
        ),
    ],
    ids=str,
)
def test_a_fleet_control_drives_pickers_to_the_end(scenario, names):
    """A fleet control drives pickers until the harvest has finished."""
    fleet = checked(Fleet(scenario, names))
    assert harvest(fleet) == []
    assert errors(fleet) == []
    for name in fleet.wires:
        if name.startswith("picker"):
            assert "/park/" in fleet.state(name)["lastNodeId"]


def test_a_picker_picks_a_row_by_one_order_released_in_steps():
    """A picker picks a row and changes bins by one order that is released step by step."""
    name = "picker_01"
    fleet = checked(Fleet(SMALL, [name], released=1))
    fleet.has_master = False
    fleet.tick()
    actions = {
        ("west/in/1", "east/out/1"): ("harvest", None),
        "east/out/1": ("drop", None),
        "east/wait/1": ("pick", None),
    }
    fleet.master.drive(name, "", ["west/in/1", "east/out/1", "east/wait/1"], actions)
    fleet.has_master = True
    fleet.until(lambda: finished(fleet.state(name)) == ["drop", "harvest", "pick"])
    states = [
        message for vehicle, topic, message in fleet.heard if (vehicle, topic) == (name, "state")
    ]
    # groupby leaves one of states that follow each other and are equal in this.
    steps = [kinds for kinds, _ in groupby(finished(state) for state in states)]
    assert steps[:4] == [[], ["harvest"], ["drop", "harvest"], ["drop", "harvest", "pick"]]
    loads = [[load["loadType"] for load in state["loads"]] for state in states]
    assert [kinds for kinds, _ in groupby(loads)] == [
        ["empty bin"],
        ["full bin"],
        [],
        ["empty bin"],
    ]


def finished(state):
    """The kinds of the actions that are finished by a state, sorted."""
    return sorted(
        action["actionType"]
        for action in state.get("actionStates", [])
        if action["actionStatus"] == "FINISHED"
    )


@pytest.mark.parametrize("dispatch", ["nearest", "predictive"])
def test_own_agents_drive_the_carriers_left_by_fleet_control(dispatch):
    """Some carriers are driven by a fleet control and the others by their own agents."""
    fleet = Fleet(SMALL | {"carriers": 3, "dispatch": dispatch}, names=["carrier_01"])
    assert harvest(fleet) == []
    assert 0 < len(fleet.master.finished) < fleet.run.engine.layout.bins


def test_the_same_run_gives_the_same_messages():
    first, second = Fleet(SMALL), Fleet(SMALL)
    for fleet in (first, second):
        for _ in range(1500):
            fleet.tick()
    assert first.heard == second.heard


MACHINES = lay_out(Scenario()).machines


@pytest.mark.parametrize(
    ("topic", "body"),
    [
        ("factsheet", factsheet_of("carrier", MACHINES["carrier"], 1.0)),
        ("factsheet", factsheet_of("picker", MACHINES["picker"], 1.0)),
        ("connection", connection_of("CONNECTION_BROKEN")),
    ],
)
def test_what_is_sent_once_is_as_the_standard_has_it(topic, body):
    message = {"headerId": 0, **HEADER, "serialNumber": "carrier_01"} | body
    check(topic, json.loads(json.dumps(message)))
