"""Calls of bins: each exchange has one carrier.

With the policy `nearest` a bin gets a carrier by itself, without the dispatcher (the head of
orchard/behaviour/bin.py has the states): it sends a Call to the heads of the lines, they answer
Offer or No, it sends Come to the nearest one, and confirms (Confirm) when that asks. Here letters
are lost and memories forgotten at each of these moments. Then a new call follows, and no bin is
lost.
"""

import pytest
from msgspec.structs import replace
from stage import Stage, empty_orchard

from orchard.behaviour.bin import CALL_AGAIN, Bin, BinMemory
from orchard.behaviour.carrier import CarrierMemory, Job
from orchard.behaviour.picker import Picker
from orchard.contract.agent import Heard, Mail, Reply
from orchard.contract.messages import Answer, Call, Come, Confirm, Here, No, Offer
from orchard.field.kinds import kind_of
from orchard.field.layout import lay_out
from orchard.field.scenario import NEAREST, Scenario
from orchard.local import Local


class HardOfHearing:
    """An agent that does not hear requests of some types before a tick."""

    def __init__(self, agent, deaf_to, until: int) -> None:
        self.agent = agent
        self.Memory = agent.Memory
        self.deaf_to = deaf_to
        self.until = until

    def tick(self, seen, mail, memory):
        if seen.tick < self.until:
            requests = [
                heard for heard in mail.requests if not isinstance(heard.body, self.deaf_to)
            ]
            mail = Mail(requests, mail.replies)
        return self.agent.tick(seen, mail, memory)


class LateAnswerer:
    """A carrier that comes when a bin sends for it; its answers to that are lost before a tick."""

    def __init__(self, agent, until: int) -> None:
        self.agent = agent
        self.Memory = agent.Memory
        self.until = until

    def tick(self, seen, mail, memory):
        action = self.agent.tick(seen, mail, memory)
        if seen.tick < self.until:
            action.answers = [
                (heard, answer)
                for heard, answer in action.answers
                if not isinstance(heard.body, Come)
            ]
        return action


class Forgetful:
    """A carrier that forgets its job at one tick, as if its memory was lost."""

    def __init__(self, agent, at: int) -> None:
        self.agent = agent
        self.Memory = agent.Memory
        self.at = at

    def tick(self, seen, mail, memory):
        if seen.tick == self.at:
            memory.job = None
            memory.plan = []
        return self.agent.tick(seen, mail, memory)


def calling_orchard(**scenario) -> Scenario:
    """Return a scenario whose first bins are full after 40 s."""
    return empty_orchard(**{"dispatch": NEAREST, "row_length": 40.0, **scenario})


def stage_with(change, **scenario) -> Stage:
    """Return a stage in which `change(name, agent)` has replaced each carrier's agent."""
    stage = Stage(calling_orchard(**scenario))
    for name, agent in stage.local.agents.items():
        if name.startswith("carrier"):
            stage.local.agents[name] = change(name, agent)
    return stage


def exchanges(stage: Stage) -> list[tuple[str, str]]:
    """Return (carrier, full bin) for each full bin that was taken."""
    coupled = stage.happened("coupled")
    return [(event.who, event.whom) for event in coupled if event.who.startswith("carrier")]


def assert_every_bin_is_taken_once(stage: Stage, rows: int = 3) -> None:
    """Harvest to the end. Each row has one bin, which is taken once."""
    stage.run_to_the_end()
    bins = [bin_name for _, bin_name in exchanges(stage)]
    assert len(bins) == rows
    assert len(set(bins)) == rows
    assert stage.world.delivered == rows


def test_the_nearest_carrier_by_road_is_sent():
    """It is the head of the line from which the way is shortest."""
    stage = Stage(calling_orchard(rows=3, pickers=2, carriers=25, row_length=70.0))
    stage.run_until(lambda: bool(exchanges(stage)), 200)
    first, _ = exchanges(stage)[0]
    assert first == "carrier_25", "its line is the southernmost; it is the last by name"


def answers(stage: Stage, tick: int, *calls: tuple[str, int]) -> list[type[Answer]]:
    """Return what the head of the queue answers to these calls, (bin, since), at a tick."""
    seen = replace(stage.local.engine.observe()["carrier_01"], tick=tick)
    mail = Mail([Heard(name, tick - 1, 0, Call(1, "east", since)) for name, since in calls])
    action = stage.local.agents["carrier_01"].tick(
        seen, mail, stage.local.memories.get("carrier_01")
    )
    stage.local.memories["carrier_01"] = action.memory
    return [type(answer) for _, answer in action.answers]


def test_a_carrier_offers_itself_only_to_the_longest_caller():
    """A carrier remembers a call for 25 ticks. A bin has 5 ticks to choose it after its offer."""
    stage = Stage(calling_orchard())
    memory = CarrierMemory(job=Job("bin_09", 1, "east", "picker_01"))
    stage.local.memories["carrier_01"] = memory
    # It is busy, and remembers the calls.
    assert answers(stage, 100, ("bin_01", 90), ("bin_02", 40)) == [No, No]
    # When it is free, it knows that another call is older.
    memory.job = None
    assert answers(stage, 110, ("bin_01", 90)) == [No]
    # Two calls are equally old: ties go by name.
    assert answers(stage, 115, ("bin_02", 40), ("bin_03", 40)) == [Offer, No]
    # The bin with the offer may still choose it.
    assert answers(stage, 118, ("bin_01", 90)) == [No]
    # The older bins call no longer, so they have a carrier.
    assert answers(stage, 141, ("bin_01", 90)) == [Offer]


def test_a_bin_that_never_decides_leaves_the_carrier_to_others():
    """After two seconds without a decision the carrier offers itself to the other bin."""
    stage = Stage(calling_orchard())
    assert answers(stage, 100, ("bin_01", 0), ("bin_02", 50)) == [Offer, No]
    assert answers(stage, 120, ("bin_01", 0), ("bin_02", 50)) == [No, Offer]


def test_a_bin_that_calls_again_says_since_when_it_has_called():
    """Bins are full after 40 s, and call until 70 s; the carrier hears no call."""
    stage = stage_with(
        lambda name, agent: HardOfHearing(agent, Call, until=2000), pickers=2, carriers=1
    )
    calls = set()
    while stage.world.tick < 700:
        stage.tick()
        for name, action in stage.local.actions.items():
            for _, body in action.requests:
                if isinstance(body, Call):
                    calls.add((name, body.since))
    assert len(calls) == 2, "each of two bins calls again and again, always since the same tick"


@pytest.mark.soak
@pytest.mark.parametrize("dispatch", ["nearest", "orchard.dispatch.ranking.Nearest"])
def test_soak_the_bins_are_served_in_the_order_of_their_calls(dispatch):
    """There is one carrier for four pickers, so bins wait. `since`: the tick since which a bin
    calls, -1 if it does not. `coming`: a carrier is on its way to it.
    """
    stage = Stage(Scenario(rows=6, pickers=4, carriers=1, seed=2003, dispatch=dispatch))
    # Of each job: since when its bin had called, and its name.
    jobs: list[tuple[int, str]] = []
    while not stage.local.engine.over:
        stage.tick()
        memories = stage.local.memories
        bins = [name for name in memories if name.startswith("bin")]
        calling = []
        for name in bins:
            if memories[name].since >= 0 and not memories[name].coming:
                calling.append((memories[name].since, name))
        job = memories["carrier_01"].job
        if job is None:
            continue
        call = (memories[job.bin].since, job.bin)
        if call[0] >= 0 and call not in jobs:
            jobs.append(call)
            assert call == min(calling), "it goes for the bin that has called for longest"
    assert len(jobs) == 6


def test_carriers_of_several_lines_free_at_once_get_bins_soon():
    stage = Stage(calling_orchard(rows=4, pickers=4, carriers=40, row_length=70.0))

    def jobs() -> list[Job]:
        memories = stage.local.memories.values()
        return [memory.job for memory in memories if getattr(memory, "job", None)]

    # A row takes 70 s, and calls and answers some seconds more.
    stage.run_until(lambda: len(jobs()) == 4, 85)


def test_a_call_that_no_carrier_answers_is_repeated():
    """Bins are full after 40 s. No carrier hears a call before tick 1,700."""
    stage = stage_with(lambda name, agent: HardOfHearing(agent, Call, until=1700))
    stage.run(165)
    assert exchanges(stage) == []
    assert_every_bin_is_taken_once(stage)


def test_a_carrier_that_does_not_answer_is_given_up():
    """The bin then sends for the head of another line."""
    stage = stage_with(
        lambda name, agent: HardOfHearing(agent, Come, until=60000 if name == "carrier_13" else 0),
        carriers=13,
        row_length=70.0,
    )
    stage.run_until(lambda: stage.world.delivered == 1, 1000)
    # The head of its line, 0.9 m east of the rows' end.
    assert stage.pose("carrier_13")[0] == 35.4, "nearest by road, but it never answers"
    assert_every_bin_is_taken_once(stage)


def test_a_bin_whose_carrier_refuses_calls_again_at_once():
    """`asked`: the tick of its last letter to a carrier. It is put back until a call is due."""
    bin_ = Bin(lay_out(calling_orchard()), "bin_01")
    memory = BinMemory(carrier="carrier_01", asked=98)
    refusal = Reply("carrier_01", 0, Come(1, "east", "picker_01"), No("on another job"))
    bin_.hear(Mail([], [refusal]), memory, tick=100)
    assert memory.carrier == ""
    assert 100 - memory.asked >= CALL_AGAIN


def test_a_bin_that_its_picker_has_again_has_no_call():
    """`since` is the tick since which a bin calls; -1: it does not call."""
    local = Local(calling_orchard())
    bin_ = Bin(local.engine.layout, "bin_01")
    action = bin_.tick(local.seen["bin_01"], Mail([], []), BinMemory(since=50))
    assert action.memory.since == -1


@pytest.mark.parametrize(
    ("brought", "why"),
    [("bin_09", "no bin is wanted"), ("bin_01", "the place is not taken over yet")],
)
def test_a_picker_with_a_bin_tells_why_it_takes_no_other(brought, why):
    local = Local(calling_orchard())
    picker = Picker(local.engine.layout, "picker_01")
    heard = Heard("carrier_01", 0, 0, Here(brought))
    action = picker.tick(local.seen["picker_01"], Mail([heard], []), None)
    assert action.answers == [(heard, No(why))]


def test_only_the_head_of_a_line_is_sent():
    """No carrier that stays may stand in the way of one that leaves."""
    stage = Stage(calling_orchard(rows=6, pickers=6, carriers=6))
    stage.run_to_the_end()
    order = [event.who for event in stage.happened("uncoupled") if event.who.startswith("carrier")]
    assert sorted(order) == [f"carrier_{i + 1:02d}" for i in range(6)]
    assert_every_bin_is_taken_once(stage, 6)


def test_a_carrier_that_came_with_a_lost_answer_is_the_only_one():
    """Bins send for a carrier from tick 400 on. Its answers are lost until tick 460."""
    stage = stage_with(lambda name, agent: LateAnswerer(agent, until=460))
    assert_every_bin_is_taken_once(stage)


def test_a_carrier_with_an_unheard_confirmation_waits_then_goes():
    """No bin hears its question before tick 700. In rows of 40 m the queue's head is at 5.4 m."""
    stage = Stage(calling_orchard())
    for name, agent in stage.local.agents.items():
        if name.startswith("bin"):
            stage.local.agents[name] = HardOfHearing(agent, Confirm, until=700)
    stage.run(69)
    assert stage.pose("carrier_01")[0] == pytest.approx(5.4), (
        "it stays in the queue until the bin has confirmed"
    )
    assert_every_bin_is_taken_once(stage)


def test_a_carrier_that_forgot_its_job_is_replaced_by_a_new_call():
    """Tick 415 is soon after the first bins, full at tick 400, have sent for carriers."""
    stage = stage_with(
        lambda name, agent: Forgetful(agent, at=415 if name == "carrier_01" else -1), carriers=3
    )
    stage.run_until(lambda: len(exchanges(stage)) == 1, 400)
    assert_every_bin_is_taken_once(stage)


def test_a_bin_shows_what_its_robot_does_with_it():
    """A whole small harvest is followed: the text on the bin, and its state."""
    run = Local(empty_orchard(rows=3, pickers=2, carriers=2, row_length=20.0, picking_speed=1.0))
    shown = set()
    while not run.ended:
        run.tick()
        for name, action in run.actions.items():
            words, _, robot = action.doing.partition(", on ")
            if kind_of(name) == "bin" and robot:
                shown.add((words, kind_of(robot), action.state))
    assert shown == {
        ("empty", "picker", "picking"),
        ("full", "picker", "waiting"),
        ("full", "carrier", "hauling"),
        ("empty", "carrier", "driving"),
    }
