"""What the processes expect of a bus: samples, tokens and queries.

Each script runs over Zenoh and over the simulated network (`tests/support/both_buses.py`). A sample
is a message on a key. A token says that its session is alive. A query is a question that any number
of queryables answer: each sends replies (`Replied`) and drops it; when all have, it is `Final`.
`received` waits for items, and `SHORT` is a time within which all else has arrived.
"""

import pytest
from both_buses import LARGE, SHORT, ask_one, is_silent, on_both, received, wait_until

from orchard.net.bus import TIMED_OUT, Alive, Final, Query, Replied, Sample
from orchard.net.endpoints import BusError


@on_both
def test_samples_of_one_session_arrive_in_order(net):
    """Nothing comes back to the session that sent it."""
    sender = net.client()
    receiver = net.client()
    for bus in (sender, receiver):
        bus.subscribe("a/*")
    wait_until(sender, lambda: sender.is_heard("a/b"))
    for number in range(200):
        sender.publish(f"a/{number % 3}", str(number).encode())
    assert [int(sample.payload) for sample in received(receiver, 200)] == list(range(200))
    assert is_silent(sender)


@on_both
def test_a_large_payload_arrives_before_a_later_small_one(net):
    """Zenoh sends a large payload in parts; a small one must not overtake them."""
    sender = net.client()
    receiver = net.client()
    net.router.subscribe("a")
    receiver.subscribe("a")
    wait_until(sender, lambda: sender.is_heard("a"))
    payloads = [bytes([number]) * LARGE for number in range(3)] + [b"small"]
    for payload in payloads:
        sender.publish("a", payload)
    for bus in (receiver, net.router):
        assert [sample.payload for sample in received(bus, len(payloads))] == payloads


@on_both
def test_a_large_reply_arrives_whole(net):
    asker, _, query = ask_one(net)
    query.reply(b"!" * LARGE)
    query.drop()
    assert received(asker, 2, Replied | Final) == [Replied(1, b"!" * LARGE, ""), Final(1)]


@on_both
def test_a_router_has_a_session_of_its_own(net):
    bus = net.client()
    bus.subscribe("to/client")
    net.router.subscribe("to/router")
    wait_until(bus, lambda: bus.is_heard("to/router"))
    wait_until(bus, lambda: net.router.is_heard("to/client"))
    bus.publish("to/router", b"1")
    net.router.publish("to/client", b"2")
    assert received(net.router, 1) == [Sample("to/router", b"1")]
    assert received(bus, 1) == [Sample("to/client", b"2")]


@on_both
def test_a_router_is_alone_at_its_endpoint(net):
    """So all sessions of a run meet at the same router."""
    bus = net.client()
    net.router.subscribe("a")
    with pytest.raises(BusError):
        net.start_router()
    wait_until(bus, lambda: bus.is_heard("a"))
    bus.publish("a", b"1")
    assert received(net.router, 1) == [Sample("a", b"1")]


@on_both
def test_two_subscriptions_that_meet_a_key_give_the_sample_twice(net):
    sender = net.client()
    receiver = net.client()
    receiver.subscribe("a/*")
    receiver.subscribe("a/b", quietly=True)
    wait_until(sender, lambda: sender.is_heard("a/b"))
    receiver.sleep(SHORT)
    sender.publish("a/b", b"1")
    assert received(receiver, 2) == [Sample("a/b", b"1")] * 2


@on_both
def test_a_publisher_knows_whether_another_session_subscribes(net):
    sender = net.client()
    receiver = net.client()
    sender.subscribe("a/b")
    assert not sender.is_heard("a/b")
    receiver.subscribe("a/**")
    wait_until(sender, lambda: sender.is_heard("a/b"))
    assert not sender.is_heard("b")
    net.close(receiver)
    wait_until(sender, lambda: not sender.is_heard("a/b"))


@on_both
def test_a_watcher_learns_of_earlier_tokens_and_changes(net):
    sender = net.client()
    receiver = net.client()
    sender.declare_alive("alive/x/1")
    sender.sleep(SHORT)
    receiver.watch("alive/*/*")
    assert received(receiver, 1, Alive) == [Alive("alive/x/1", True)]
    sender.declare_alive("alive/y/1")
    sender.withdraw("alive/x/1")
    assert received(receiver, 2, Alive) == [Alive("alive/y/1", True), Alive("alive/x/1", False)]
    net.close(sender)
    assert received(receiver, 1, Alive) == [Alive("alive/y/1", False)]


@on_both
def test_tokens_of_two_sessions_with_one_key_are_one_token(net):
    watcher = net.client()
    sender = net.client()
    receiver = net.client()
    watcher.watch("alive/*/*")
    for bus in (sender, receiver):
        bus.declare_alive("alive/x/1")
        bus.sleep(SHORT)
    assert received(watcher, 1, Alive) == [Alive("alive/x/1", True)]
    net.close(sender)
    assert is_silent(watcher)
    receiver.withdraw("alive/x/1")
    assert received(watcher, 1, Alive) == [Alive("alive/x/1", False)]


@on_both
def test_all_queryables_reply_and_then_it_is_final(net):
    """Each queryable may reply several times; when all have dropped the query, it is final."""
    asker = net.client()
    sender = net.client()
    receiver = net.client()
    sender.answer("a/one")
    receiver.answer("a/*")
    asker.sleep(SHORT)
    asker.ask("a/one", b"?", "ticket")
    for bus, payloads in ((sender, [b"1", b"2"]), (receiver, [b"3"])):
        (query,) = received(bus, 1, Query)
        assert query.key == "a/one"
        assert query.payload == b"?"
        for payload in payloads:
            query.reply(payload)
        query.drop()
    items = received(asker, 4, Replied | Final)
    assert sorted(item.payload for item in items[:3]) == [b"1", b"2", b"3"]
    assert items[3] == Final("ticket")


@on_both
def test_a_refusal_is_an_error_and_the_end(net):
    asker, _, query = ask_one(net)
    query.refuse("no")
    assert received(asker, 2, Replied | Final) == [Replied(1, b"", "no"), Final(1)]


@on_both
def test_a_query_with_wildcards_has_the_key_that_was_asked(net):
    _, _, query = ask_one(net, "*")
    assert query.key == "*"


@on_both
def test_a_query_that_meets_no_queryable_is_final_at_once(net):
    asker = net.client()
    asker.ask("a", b"", 1, 100.0)
    assert received(asker, 1, Replied | Final) == [Final(1)]


@on_both
def test_a_session_answers_its_own_query(net):
    bus = net.client()
    bus.answer("a")
    bus.ask("a", b"?", 1)
    (query,) = received(bus, 1, Query)
    query.reply(b"!")
    query.drop()
    assert received(bus, 2, Replied | Final) == [Replied(1, b"!", ""), Final(1)]


@on_both
def test_a_query_that_is_not_dropped_ends_with_its_time(net):
    """`ask_one` waits for SHORT before it asks, and the query is given 1 s."""
    begun = net.router.clock()
    asker, _, query = ask_one(net, seconds=1.0)
    query.reply(b"!")
    assert received(asker, 3, Replied | Final) == [
        Replied(1, b"!", ""),
        Replied(1, b"", TIMED_OUT),
        Final(1),
    ]
    assert asker.clock() - begun >= SHORT + 0.9
    query.reply(b"late")
    assert is_silent(asker)


@on_both
def test_a_query_is_final_when_the_answerer_goes(net):
    asker, answerer, _ = ask_one(net, seconds=100.0)
    net.close(answerer)
    assert received(asker, 1, Replied | Final) == [Final(1)]


@on_both
def test_after_a_cut_tokens_and_declarations_come_back(net):
    """What sessions declared before the cut, they declare again by themselves."""
    bus = net.client()
    net.router.declare_alive("alive/physics/1")
    net.router.watch("alive/x/*")
    bus.watch("alive/physics/*")
    bus.subscribe("a")
    bus.answer("b")
    bus.declare_alive("alive/x/1")
    assert received(bus, 1, Alive) == [Alive("alive/physics/1", True)]
    assert received(net.router, 1, Alive) == [Alive("alive/x/1", True)]
    net.cut()
    assert received(bus, 2, Alive) == [
        Alive("alive/physics/1", False),
        Alive("alive/physics/1", True),
    ]
    assert received(net.router, 2, Alive) == [Alive("alive/x/1", False), Alive("alive/x/1", True)]
    wait_until(bus, lambda: net.router.is_heard("a"))
    net.router.publish("a", b"1")
    assert received(bus, 1) == [Sample("a", b"1")]
    net.router.ask("b", b"", 1)
    received(bus, 1, Query)[0].refuse("no")
    assert received(net.router, 2, Replied | Final) == [Replied(1, b"", "no"), Final(1)]


@on_both
def test_a_cut_ends_a_query_that_is_under_way(net):
    asker = net.client()
    net.router.answer("a")
    asker.sleep(SHORT)
    asker.ask("a", b"", 1, 100.0)
    (query,) = received(net.router, 1, Query)
    net.cut()
    assert received(asker, 1, Replied | Final) == [Final(1)]
    query.reply(b"late")
    query.drop()
    assert is_silent(asker)


@on_both
def test_a_token_that_flaps_is_seen_unless_another_holds_it(net):
    """Beside the session that holds the token, a client that withdraws it is not seen.

    So no client can make it look as if physics had gone.
    """
    watcher = net.client()
    sender = net.client()
    flapping = net.client()
    watcher.watch("alive/*/*")
    for _ in range(3):
        flapping.declare_alive("alive/x/1")
        assert received(watcher, 1, Alive) == [Alive("alive/x/1", True)]
        flapping.withdraw("alive/x/1")
        assert received(watcher, 1, Alive) == [Alive("alive/x/1", False)]
    sender.declare_alive("alive/x/1")
    assert received(watcher, 1, Alive) == [Alive("alive/x/1", True)]
    for _ in range(3):
        flapping.declare_alive("alive/x/1")
        flapping.withdraw("alive/x/1")
    assert is_silent(watcher)
