"""The rules of lockstep without a network: mail, which session owns which agent, and velocities
that physics does not wait for.

The head of orchard/net/mailbox.py has the rules of mail by number. A request of tick k is heard at
k + 1, and its answer at k + 2. By default `letter` is a request of bin_01 of tick 4, so that it is
heard at tick 5.
"""

import pytest
from recorded_messages import RUN, Clock, heard_at, letter, roster
from recorded_messages import ReadQuery as Query

from orchard.contract.agent import MOST_HOLD, Action, Heard
from orchard.contract.mail import LocalMail
from orchard.contract.messages import Given, StateRequest, Written, Yes, pack
from orchard.field.geometry import Twist
from orchard.net.mailbox import Mailbox, RealtimeMailbox
from orchard.net.refusals import Refused
from orchard.server.barriers import LockstepBarrier
from orchard.server.commands import UnownedCommands
from orchard.server.control import Pacer
from orchard.server.options import PATIENCE
from orchard.wire.messages import Angular, Answered, AskedOf, Linear, Received, Report, Velocity


def mailbox(tick=5):
    """Return a mailbox whose session has joined at a tick."""
    box = Mailbox(RUN)
    box.join(tick)
    return box


def settled(tick):
    """Return a mailbox that has been there for the two ticks before a tick.

    It waits for requests: one that has just joined waits for none.
    """
    box = mailbox(tick - 2)
    for before in (tick - 2, tick - 1):
        box.deliver(before)
    return box


# -- rules 3, 5 and 7: the agent that is asked


def test_a_request_is_heard_and_answered_at_the_next_tick():
    box = mailbox()
    query = Query(letter(tick=5))
    box.hear("picker_01", query)
    assert query.replies == [Received(RUN, 5)]
    assert heard_at(box, 5) == []
    (heard,) = heard_at(box, 6)
    box.write("picker_01", Action(answers=[(heard, Yes())]))
    box.close()
    assert query.replies[1] == Answered(RUN, 6, Yes())
    assert query.dropped


def test_requests_are_heard_in_one_order():
    box = mailbox()
    for sender, number in [("bin_02", 1), ("bin_03", 0), ("bin_02", 0), ("bin_01", 3)]:
        box.hear("picker_01", Query(letter(sender, 4, number)))
    assert [(heard.sender, heard.number) for heard in heard_at(box, 5)] == [
        ("bin_01", 3),
        ("bin_02", 0),
        ("bin_02", 1),
        ("bin_03", 0),
    ]


def test_an_unanswered_query_is_told_in_its_tick():
    """If no agent answers a request, its sender learns that in the tick in which it is heard."""
    box = mailbox()
    query = Query(letter(tick=4))
    box.hear("picker_01", query)
    box.deliver(5)
    box.close()
    assert query.replies[1:] == [Answered(RUN, 5, None)]
    assert query.dropped


@pytest.mark.parametrize("tick", [0, 3, 5 + MOST_HOLD])
def test_a_request_of_the_past_or_far_future_is_dropped(tick):
    """The far future is beyond any hold."""
    box = mailbox(5)
    query = Query(letter(tick=tick))
    with pytest.raises(Refused, match="tick"):
        box.hear("picker_01", query)
    assert query.dropped
    assert not query.replies


def test_a_request_after_its_heard_copy_is_no_fault():
    """A host that joins hears the requests of its first two ticks from the copies of physics.

    The queries may come later, in a run without any fault. They are dropped and not refused, and
    the request is not heard a second time.
    """
    box = mailbox(5)
    query = Query(letter(tick=5))
    for tick in (5, 6, 7):
        box.deliver(tick)
        if tick < 7:
            box.recall(tick)
    box.hear("picker_01", query)
    assert query.dropped
    assert not query.replies
    assert 5 not in [heard.tick for mail in box.deliver(8).values() for heard in mail.requests]


def test_a_repeat_takes_the_place_of_what_it_repeats():
    box = mailbox()
    first = Query(letter())
    second = Query(letter())
    box.hear("picker_01", first)
    box.hear("picker_01", second)
    assert first.dropped
    assert len(heard_at(box, 5)) == 1


def test_nonsense_gets_an_error_reply():
    query = Query(b"\xc1")
    with pytest.raises(Refused):
        mailbox().hear("picker_01", query)
    assert query.errors[0].startswith("malformed")


def test_an_answer_to_what_was_heard_earlier_goes_nowhere():
    """The agent answers at tick 6 what it heard at 5. The sender has learned at 5 that no answer
    comes, and gets no second one.
    """
    box = mailbox()
    query = Query(letter(tick=4))
    box.hear("picker_01", query)
    (heard,) = heard_at(box, 5)
    box.close()
    box.deliver(6)
    box.write(
        "picker_01",
        Action(answers=[(heard, Yes()), (Heard("bin_09", 5, 0, StateRequest()), Yes())]),
    )
    assert query.replies[1:] == [Answered(RUN, 5, None)]


# -- rules 2, 4, 6 and 8: the agent that asks


def ask(box, tick=5):
    """Let bin_01 ask picker_01 at a tick. Return the request that is to be sent."""
    box.deliver(tick)
    (request,) = box.write("bin_01", Action(requests=[("picker_01", StateRequest())]))
    return request


def test_a_tick_waits_for_every_request_physics_tells_of():
    box = settled(5)
    expected = [AskedOf("picker_01", "bin_01", 0), AskedOf("picker_01", "bin_02", 3)]
    assert box.is_settled(5, [])
    assert not box.may_lack_mail(5, [])
    box.hear("picker_01", Query(letter("bin_01", 4, 0)))
    box.hear("picker_01", Query(letter("bin_02", 4, 2)))
    box.hear("picker_01", Query(letter("bin_02", 5, 3)))
    # Of bin_02, one request has another number, and the other is of another tick.
    assert not box.is_settled(5, expected)
    assert box.may_lack_mail(5, expected)
    box.hear("picker_01", Query(letter("bin_02", 4, 3)))
    assert box.is_settled(5, expected)
    assert not box.may_lack_mail(5, expected)


def test_a_session_that_has_just_joined_waits_for_no_request():
    assert mailbox(5).is_settled(5, [AskedOf("picker_01", "bin_01", 0)])


def test_a_tick_waits_until_each_get_of_two_ticks_ago_is_final():
    box = mailbox()
    request = ask(box)
    box.deliver(6)
    assert not box.is_settled(7, [])
    request.final = True
    assert box.is_settled(7, [])


def test_an_answer_is_heard_two_ticks_after_the_request():
    box = mailbox()
    request = ask(box)
    box.replied(request, pack(Received(RUN, 5)))
    box.replied(request, pack(Answered(RUN, 6, Yes())))
    assert box.deliver(6) == {}
    ((reply,),) = (mail.replies for mail in box.deliver(7).values())
    assert reply.sender == "picker_01"
    assert reply.number == 0
    assert reply.body == Yes()


def test_in_realtime_an_answer_is_heard_once():
    box = RealtimeMailbox(RUN)
    box.join(5)
    request = ask(box)
    box.replied(request, pack(Received(RUN, 5)))
    box.replied(request, pack(Answered(RUN, 6, Yes())))
    request.final = True
    ((reply,),) = (mail.replies for mail in box.deliver(6).values())
    assert reply.body == Yes()
    assert box.deliver(7) == {}


def test_no_answer_is_heard_as_none():
    box = mailbox()
    ask(box).final = True
    box.deliver(6)
    assert box.deliver(7)["bin_01"].replies[0].body is None


@pytest.mark.parametrize("tick", [5, 7])
def test_an_answer_of_another_tick_is_refused(tick):
    box = mailbox()
    request = ask(box)
    box.replied(request, pack(Received(RUN, 5)))
    with pytest.raises(Refused, match="an answer of"):
        box.replied(request, pack(Answered(RUN, tick, Yes())))
    assert request.answer is None


def test_a_session_that_joins_again_forgets_all_mail():
    box = mailbox()
    query = Query(letter())
    box.hear("picker_01", query)
    ask(box)
    box.join(7)
    assert query.dropped
    assert box.is_settled(7, [])
    assert box.deliver(7) == {}


# -- which session owns which agent


def test_an_agent_has_one_owner_until_that_one_is_gone():
    roster_ = roster(("picker_01", "a"))
    roster_.token("picker_01", "b", True)
    assert (
        roster_.may_join("picker_01", "b")
        == "it is taken, by session a; a run that is started --without picker_01 leaves it to"
        " others"
    )
    assert roster_.may_join("picker_01", "a") == ""
    roster_.token("picker_01", "a", False)
    assert roster_.may_join("picker_01", "b") == ""


def test_strangers_and_the_silent_cannot_join():
    assert roster().may_join("picker_99", "a") == "there is no such agent"
    assert roster().may_join("picker_01", "a") == "its liveliness token is missing"


def test_the_released_are_told_by_owner():
    roster_ = roster(("picker_01", "a"), ("bin_01", "a"))
    assert roster_.release({"picker_01", "bin_01"}) == {"a": ["bin_01", "picker_01"]}
    assert roster_.owners == {}


def velocity(tick):
    return Velocity(RUN, tick, Linear(1.0), Angular(0.0))


def action(owner="a", tick=3, x=1.0):
    """Return the arguments of `take` for an answer to a tick: forward at x, m/s."""
    return owner, tick, Report(Twist(x))


def test_a_tick_takes_one_answer_from_each_owner():
    answers = LockstepBarrier(roster(("picker_01", "a"), ("bin_01", "b")), Clock())
    answers.open(3)
    for wrong, reason in [
        (action("b"), "not the owner"),
        (action(tick=2), "past tick"),
        (action(tick=4), "future tick"),
    ]:
        with pytest.raises(Refused, match=reason):
            answers.take("picker_01", *wrong)
    answers.take("picker_01", *action())
    with pytest.raises(Refused, match="answered already"):
        answers.take("picker_01", *action(x=0.5))
    assert answers.missing == {"bin_01"}


def test_an_answer_that_comes_again_counts_once():
    """A host sends its answer again when a tick comes again, because the first may only be slow.

    So the answer to tick 3 may come a second time at tick 7, and is passed over there. A different
    one for tick 3 is refused.
    """
    answers = LockstepBarrier(roster(("picker_01", "a"), ("bin_01", "b")), Clock())
    answers.open(3)
    for _ in range(2):
        answers.take("picker_01", *action())
    assert set(answers.actions()) == {"picker_01"}
    answers.open(7, due=["bin_01"])
    answers.take("picker_01", *action())
    assert answers.actions() == {}
    with pytest.raises(Refused, match="past tick"):
        answers.take("picker_01", *action(x=0.5))


def test_an_equal_answer_counts_anew_after_a_takeover():
    """The session has taken the agent again since (`expect`), so it must answer again."""
    answers = LockstepBarrier(roster(("picker_01", "a")), Clock())
    answers.open(3)
    answers.take("picker_01", *action())
    answers.expect("picker_01")
    answers.take("picker_01", *action())
    assert answers.missing == set()


def test_no_agent_answers_in_anothers_place():
    """A tick's mail is copied to all, and only the answer of the agent that was asked counts."""
    asked = Written([("bin_01", StateRequest())], [])
    given = [Given("picker_01", 3, 0, Yes())]
    for answers, body in (
        ({"bin_02": Written([], given)}, None),
        ({"bin_01": Written([], given)}, Yes()),
    ):
        (reply,) = LocalMail({3: {"picker_01": asked}, 4: answers}).deliver(5)["picker_01"].replies
        assert reply.sender == "bin_01"
        assert reply.body == body


def test_each_that_comes_back_gives_all_time_once_a_tick():
    """Patience is 15 s. Each agent that is taken anew within a tick starts it afresh, once.

    Agents are taken 10, 20 and 30 s after the clock's beginning, at 100 s.
    """
    clock = Clock()
    answers = LockstepBarrier(roster(("picker_01", "a"), ("bin_01", "b")), clock)
    answers.open(3)
    for name, deadline in (
        ("picker_01", 110.0 + PATIENCE),
        ("bin_01", 120.0 + PATIENCE),
        ("picker_01", 120.0 + PATIENCE),
    ):
        clock.now += 10.0
        answers.expect(name)
        assert answers.deadline == deadline
    answers.open(4)
    answers.expect("picker_01")
    assert answers.deadline == clock.now + PATIENCE


def test_answers_are_applied_in_one_order():
    answers = LockstepBarrier(roster(("picker_01", "a"), ("bin_01", "a")), Clock())
    answers.open(3)
    for name in ("picker_01", "bin_01"):
        answers.take(name, *action())
    assert list(answers.actions()) == ["bin_01", "picker_01"]


# -- velocities that physics does not wait for


def loose(ticks):
    """Return the commands for robots that no session holds, and their clock."""
    clock = Clock()
    commands = UnownedCommands(clock)
    for tick in range(ticks):
        commands.begin(tick)
    return commands, clock


def test_what_is_older_than_half_a_second_is_past():
    """Half a second is five ticks, or 0.5 s of wall time, whichever is longer.

    Ticks 0 to 19 begin at one moment of the clock, so at first none of them is past, unless the
    robot has a newer velocity. After 0.5 s those before tick 16 are.
    """
    commands, clock = loose(20)
    commands.take("picker_01", velocity(10))
    with pytest.raises(Refused, match="past tick"):
        commands.take("picker_01", velocity(9))
    commands.take("bin_01", velocity(1))
    clock.now += 0.5
    commands.begin(20)
    with pytest.raises(Refused, match="past tick"):
        commands.take("weed_01", velocity(15))
    with pytest.raises(Refused, match="future tick"):
        commands.take("weed_01", velocity(21))
    commands.take("weed_01", velocity(16))


def test_ticks_are_spread_over_time_and_a_little_is_made_good():
    """At twice the speed a tick of 0.1 s takes 0.05 s.

    A delay of 10 s is forgotten but for CATCH_UP: five ticks of 0.05 s follow at once, and the
    others wait again.
    """
    clock = Clock()
    pacer = Pacer(2.0, clock)
    pacer.begin()
    assert pacer.wait() == pytest.approx(0.05)
    clock.now += 10.0
    pacer.begin()
    assert pacer.wait() == 0.0
    clock.now += Pacer.CATCH_UP
    assert pacer.wait() == 0.0
    for _ in range(20):
        pacer.begin()
    assert 0.0 < pacer.wait() < 1.0
