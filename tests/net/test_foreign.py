"""Clients that are written from keyspace.md alone: a carrier works a whole harvest, and a holder is
asked as seldom as an agent of ours.

They are examples/foreign_*.py, which import nothing of this program. The tests compare what they
compute with what this program computes. A holder says until when its velocity stands (`Hold`).
"""

import re
import sys
from pathlib import Path

import msgpack
import pytest
from command_line import python
from local_runs import SMALL, played
from patience import PATIENCE
from stage import ONE_WAY, empty_orchard

from examples import (
    foreign_carrier,
    foreign_field,
    foreign_holder,
    foreign_host,
    foreign_obstacles,
    foreign_steps,
)
from orchard import Action, Hold, Local, Twist, Zone
from orchard.contract.agent import Heard, Mail, Reply
from orchard.contract.mail import digest_of, in_hearing_order
from orchard.contract.messages import Come, Confirm, No, Offer, Position, StateRequest, Where, pack
from orchard.field.kinds import ANIMALS, KINDS, PEOPLE
from orchard.field.layout import lay_out
from orchard.field.scenario import Animals, People, Scenario
from orchard.plans.route import OneWay

pytestmark = pytest.mark.processes


def harvest(fleet, scenario, name="carrier_01", seconds=PATIENCE) -> dict:
    """Let a foreign client drive a carrier through a harvest.

    Return the message `end`, and as `taken` how many bins the client says that it took.
    """
    fleet.physics(scenario, "--duration", "20000")
    ends = fleet.client().hear("orchard/end")
    fleet.host("--without", name)
    # -I: Python finds no module of this project.
    done = python("-I", foreign_carrier.__file__, fleet.endpoint, name, seconds=seconds)
    fleet.end()
    taken = int(re.fullmatch(r"(\d+) bins taken\n", done.stdout)[1])
    return ends.get(timeout=PATIENCE) | {"taken": taken}


def assert_all_delivered(end, rows) -> None:
    summary = end["summary"]
    assert end["why"] == "harvested"
    assert end["finished"]
    assert summary["violations"] == []
    assert summary["jam"] == []
    assert summary["rows_picked"] == rows
    assert summary["bins_delivered"] == rows
    assert summary["collisions"] == 0
    assert summary["messages_refused"] == {}
    assert summary["broken_agents"] == []


def test_a_carrier_written_from_keyspace_alone_harvests(fleet):
    end = harvest(fleet, SMALL.model_copy(update=ONE_WAY))
    assert_all_delivered(end, SMALL.rows)
    assert end["taken"] == SMALL.rows


# Other orchards, and the carrier that the foreign client drives in each.
OTHERS = {
    "people and animals": (Scenario(rows=4, pickers=3, carriers=2), "carrier_01"),
    "wide rows, noise": (
        Scenario(
            rows=3,
            carriers=1,
            row_width=8.0,
            laser={"noise": 0.01},
            animals=Animals(dogs=0, cats=0),
        ),
        "carrier_01",
    ),
    "a second line of the queue": (
        Scenario(rows=16, pickers=16, carriers=13, weeds=0),
        "carrier_13",
    ),
    "a dispatcher": (
        Scenario(rows=3, carriers=2, dispatch="examples.seams.farthest_first.FarthestFirst"),
        "carrier_02",
    ),
    "an early dispatcher": (Scenario(rows=3, carriers=2, dispatch="predictive"), "carrier_02"),
}


@pytest.mark.soak
@pytest.mark.parametrize("what", OTHERS)
def test_the_foreign_carrier_harvests_other_orchards_too(fleet, what):
    scenario, name = OTHERS[what]
    end = harvest(fleet, scenario, name, 4 * PATIENCE)
    assert_all_delivered(end, scenario.rows)
    assert end["taken"] > 0


def test_foreign_clients_import_nothing_of_this_program():
    modules = (foreign_carrier, foreign_steps, foreign_field, foreign_obstacles, foreign_host)
    text = "".join(Path(module.__file__).read_text() for module in modules)
    imports = re.findall(r"^\s*(?:import|from) ([\w.]+)", text, re.M)
    assert {name.partition(".")[0] for name in imports} - sys.stdlib_module_names == {
        "msgpack",
        "zenoh",
        "foreign_field",
        "foreign_host",
        "foreign_obstacles",
        "foreign_steps",
    }


def test_the_foreign_carrier_ignores_an_unknown_field():
    """A call of a bin with a field `more` of a later version is answered all the same."""
    carrier = foreign_carrier.Carrier({"scenario": SMALL.model_dump(), "agents": []}, "carrier_01")
    carrier.tick = 7
    carrier.x = 35.4
    carrier.y = 24.5
    carrier.twist = (0.0, 0.0, 0.0)
    call = {"type": "call", "lane": 1, "side": "east", "since": 7, "more": [7]}
    carrier.hear_calls([("bin_01", 7, 0, call)])
    assert carrier.reply_to("bin_01", call)["type"] == "offer"


def test_the_foreign_digest_of_mail_is_ours():
    """The digest of the mail that an agent heard goes into the run's hash.

    The letters have names, numbers and texts of all lengths that msgpack writes in different ways.
    """
    heard = [
        Heard("bin_02", 7, 1, Come(3, "west", "picker_01")),
        Heard("bin_01", 7, 70_000, Come(300, "east", "p" * 40)),
        Heard("dog_01", 7, 0, Confirm()),
    ]
    replies = [
        Reply("dog_01", 0, Where(), Position(-3.0, 1e-9)),
        Reply("bin_01", 1, StateRequest(), None),
        Reply("cat_01", 2, Where(), No("é" * 300)),
        Reply("cat_01", 3, Where(), Offer(0.1, -0.0, 2.0**40)),
    ]
    on_the_wire = msgpack.unpackb(
        pack([[*heard], [(reply.sender, reply.number, reply.body) for reply in replies]])
    )
    requests = foreign_host.in_order(on_the_wire[0])
    assert [request[0] for request in requests] == [
        request.sender for request in in_hearing_order(heard)
    ]
    assert foreign_host.digest_of(requests, on_the_wire[1]) == digest_of(
        Mail(in_hearing_order(heard), replies)
    )
    assert foreign_host.digest_of([], []) == digest_of(Mail())


@pytest.mark.parametrize("number", [1, 13, 40])
def test_the_foreign_field_is_ours(number):
    """A figure that changes in the orchard must change in foreign_field.py, too.

    It stands in keyspace.md.
    """
    scenario = Scenario(rows=6, row_width=7.0, pickers=4, carriers=number, **ONE_WAY)
    layout = lay_out(scenario)
    route = OneWay(lay_out(scenario))
    field = foreign_field.Field(scenario.model_dump(), f"carrier_{number:02d}")
    assert field.D == route.D_ROAD
    assert field.F == route.F_ROAD
    assert field.FULL == route.FULL_BIN
    assert field.PICKER == route.WAITING
    assert route.COUPLING == field.COUPLES
    assert layout.queue.turn_off == field.TURN_OFF
    assert field.STOP == route.STOP
    assert field.HOLD == route.HOLD
    assert field.CLEAR == route.CLEAR
    assert field.bottom_d == route.outer_bottom
    assert field.bottom_f == route.inner_bottom
    assert field.top_clear == route.top_clear
    assert layout.queue.head == field.HEAD
    assert field.line == layout.queue.place(number - 1).y
    for lane in layout.lanes:
        assert field.lane(lane.number) == lane.y
        for side in ("east", "west"):
            distance = route.distance(30.0, 20.0, lane.number, route.sides[side])
            assert field.distance(30.0, 20.0, lane.number, field.side(side)) == pytest.approx(
                distance
            )


def test_the_foreign_bodies_are_ours():
    own = KINDS["carrier"]
    others = {name: KINDS[name] for name in PEOPLE + ANIMALS}
    assert {
        name: (kind.length, kind.width, kind.speed) for name, kind in others.items()
    } == foreign_obstacles.BYSTANDERS
    sizes = (
        foreign_obstacles.LENGTH,
        foreign_obstacles.WIDTH,
        foreign_obstacles.TOWS,
        foreign_obstacles.BIN,
    )
    assert sizes == (own.length, own.width, own.tows, KINDS["bin"].length)


TICKS = 400
SCENARIO = empty_orchard(people=People(workers=1, visitors=0))
AHEAD = Zone(*foreign_holder.ZONE)


class Walker:
    """Does what examples/foreign_holder.py does, as an agent of this process.

    It walks while the zone ahead is free, and else turns. It counts how often it is asked.
    """

    Memory = dict
    holds = True

    def __init__(self):
        self.asked = 0

    def tick(self, seen, mail, memory):
        self.asked += 1
        free = not AHEAD.is_occupied(seen)
        hold = Hold(seen.tick + foreign_holder.HELD, watch=(AHEAD,))
        return Action(
            Twist(0.5 if free else 0.0, 0.0, 0.0 if free else 0.5),
            doing="walking",
            state="driving",
            hold=hold,
        )


def test_a_foreign_client_holds_its_velocity(fleet):
    """The client is asked as often as the walker of this process, and the hash is the same.

    It prints how often it was asked, and the ticks of the run.
    """
    walker = Walker()
    local = played(Local(SCENARIO, {"worker_01": walker}), TICKS)
    assert TICKS / foreign_holder.HELD < walker.asked < TICKS / 5, "its zone ended some holds"
    others = [
        word
        for name in local.engine.layout.agents
        if name != "worker_01"
        for word in ("--absent", name)
    ]
    fleet.physics(SCENARIO, "--duration", str(TICKS / 10), *others)
    assert (
        python("-I", foreign_holder.__file__, fleet.endpoint, "worker_01").stdout
        == f"{walker.asked} {TICKS}\n"
    )
    assert fleet.end() == local.engine.hash
