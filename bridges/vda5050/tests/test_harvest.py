"""Harvests in which a fleet control drives the carriers, in virtual time; all messages are as the
standard has them.
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
    """Check all messages of both sides, as they are sent."""
    send = fleet.master.send

    def send_checked(name, topic, message):
        check(topic, message)
        send(name, topic, message)

    fleet.master.send = send_checked
    return fleet


def harvested(fleet):
    """Drive the harvest to its end. Return the collisions of vehicles."""
    bumps = []
    while not fleet.run.engine.over:
        assert fleet.run.engine.tick < 20_000, [fleet.state(name) for name in fleet.wires]
        bumps += [
            event
            for event in fleet.tick()
            if event.what == "collision" and event.who in fleet.wires
        ]
    for _, topic, message in fleet.heard:
        check(topic, message)
    return bumps


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
    assert harvested(fleet) == []
    done = [e for name in fleet.wires for e in fleet.state(name)["errors"]]
    assert done == [] and {topic for _, topic, _ in fleet.heard} == {"state", "visualization"}


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
    assert harvested(fleet) == []
    assert [error for name in fleet.wires for error in fleet.state(name)["errors"]] == []
    assert all(
        "/park/" in fleet.state(name)["lastNodeId"]
        for name in fleet.wires
        if name.startswith("picker")
    )


def test_a_picker_picks_a_row_by_one_order_released_in_steps():
    """A picker picks a row and changes bins by one order that is released step by step."""
    fleet, name = checked(Fleet(SMALL, ["picker_01"], released=1)), "picker_01"
    fleet.has_master = False
    fleet.tick()
    row, bins = ("west/in/1", "east/out/1"), ("east/out/1", "east/wait/1")
    fleet.master.drive(
        name,
        "",
        [*row, "east/wait/1"],
        dict(zip((row, *bins), [("harvest", None), ("drop", None), ("pick", None)], strict=True)),
    )
    fleet.has_master = True
    fleet.until(
        lambda: (
            [one["actionStatus"] for one in fleet.state(name).get("actionStates", [])]
            == ["FINISHED"] * 3
        )
    )
    states = [message for who, topic, message in fleet.heard if (who, topic) == (name, "state")]
    done = [
        sorted(
            one["actionType"] for one in state["actionStates"] if one["actionStatus"] == "FINISHED"
        )
        for state in states
    ]
    assert [kinds for kinds, _ in groupby(done)][:4] == [
        [],
        ["harvest"],
        ["drop", "harvest"],
        ["drop", "harvest", "pick"],
    ]
    loads = [[load["loadType"] for load in state["loads"]] for state in states]
    assert [kinds for kinds, _ in groupby(loads)] == [
        ["empty bin"],
        ["full bin"],
        [],
        ["empty bin"],
    ]


@pytest.mark.parametrize("dispatch", ["nearest", "predictive"])
def test_own_agents_drive_the_carriers_left_by_fleet_control(dispatch):
    """Some carriers are driven by a fleet control and the others by their own agents."""
    fleet = Fleet(SMALL | {"carriers": 3, "dispatch": dispatch}, names=["carrier_01"])
    assert harvested(fleet) == []
    assert fleet.master.finished and len(fleet.master.finished) < fleet.run.engine.layout.bins


def test_the_same_run_gives_the_same_messages():
    runs = [Fleet(SMALL), Fleet(SMALL)]
    for fleet in runs:
        for _ in range(1500):
            fleet.tick()
    assert runs[0].heard == runs[1].heard


@pytest.mark.parametrize(
    "message",
    [
        *(
            ("factsheet", factsheet_of(kind, lay_out(Scenario()).machines[kind], 1.0))
            for kind in ("carrier", "picker")
        ),
        ("connection", connection_of("CONNECTION_BROKEN")),
    ],
    ids=lambda pair: pair[0],
)
def test_what_is_sent_once_is_as_the_standard_has_it(message):
    topic, body = message
    check(
        topic,
        json.loads(json.dumps({"headerId": 0, **HEADER, "serialNumber": "carrier_01"} | body)),
    )
