"""Payloads that a link tears or changes, over Zenoh and over the simulated network.

`net.damage(sent, arrived)` lets the link deliver other bytes for some, and `net.heal` ends that.
The tests show that the simulated network treats such payloads as Zenoh does.
"""

from random import Random

from both_buses import LARGE, SHORT, is_silent, on_both, received, wait_until

from chaos.simulated.tearing import Tearer, Tears, is_message
from orchard.contract.messages import pack
from orchard.net.bus import Alive, Final, Query, Replied
from orchard.net.refusals import Refused, read_message
from orchard.wire.messages import Departure, Lost, Recall, Recalled

RUN = "run1"

# A torn payload ends with bytes of an earlier message; in a changed one a byte has another value.
KINDS_OF_TEARS = (Tears(torn=1.0), Tears(changed=1.0))


def damaged(key: str, payload: bytes, tears: Tears, is_reply: bool = False) -> bytes:
    """Return a payload as a link tears it. No receiver can take it for a message.

    What tears it ends it with bytes of an earlier message, and may by chance change nothing: so it
    is tried again.
    """
    tearer = Tearer(tears, Random(1), lambda: None)
    earlier = pack(Lost("another run", 7, ["bin_01"], "a"))
    for _ in range(100):
        tearer.carry(key, earlier, is_reply)
        arrived = tearer.carry(key, payload, is_reply)
        if arrived != payload:
            assert not is_message(key, arrived, is_reply)
            return arrived
    raise AssertionError(f"{payload!r} is not torn")


def refusal_of(payload: bytes, type_: type) -> str:
    """Return why a receiver refuses a payload; '' if it takes it."""
    try:
        read_message(payload, type_, RUN)
    except Refused as refusal:
        return refusal.reason
    return ""


@on_both
def test_a_torn_payload_arrives_torn_and_what_follows_whole(net):
    """The link stays: the receiver refuses the damaged payload, and the next one is whole."""
    key = "orchard/hosts/a/left"
    whole = pack(Departure(RUN))
    sender = net.client()
    receiver = net.client()
    sender.declare_alive("alive/x/1")
    receiver.watch("alive/x/*")
    received(receiver, 1, Alive)
    receiver.subscribe("orchard/hosts/*/left")
    wait_until(sender, lambda: sender.is_heard(key))
    for tears in KINDS_OF_TEARS:
        torn = damaged(key, whole, tears)
        net.damage(whole, torn)
        sender.publish(key, whole)
        assert [sample.payload for sample in received(receiver, 1)] == [torn]
        assert refusal_of(torn, Departure) == "malformed"
        net.heal()
        sender.publish(key, whole)
        assert [refusal_of(sample.payload, Departure) for sample in received(receiver, 1)] == [""]
    assert is_silent(receiver)


@on_both
def test_a_torn_payload_of_a_stranger_is_told_by_its_bytes(net):
    """Any session may publish on a key, so a receiver judges a payload by its bytes alone."""
    key = "orchard/hosts/a/left"
    whole = pack(Departure(RUN))
    torn = damaged(key, whole, KINDS_OF_TEARS[0])
    owner = net.client()
    stranger = net.client()
    receiver = net.client()
    receiver.subscribe(key)
    for bus in (owner, stranger):
        wait_until(bus, lambda bus=bus: bus.is_heard(key))
    stranger.publish(key, torn)
    assert [sample.payload for sample in received(receiver, 1)] == [torn]
    owner.publish(key, whole)
    assert [sample.payload for sample in received(receiver, 1)] == [whole]
    assert [refusal_of(payload, Departure) for payload in (torn, whole)] == ["malformed", ""]


@on_both
def test_a_torn_question_and_a_torn_reply_end_as_others_do(net):
    """A torn question and a torn reply arrive as they are. The query ends as any other."""
    key = "orchard/recall"
    question = pack(Recall(RUN, 7))
    reply = pack(Recalled(RUN, 7, []))
    asker = net.client()
    receiver = net.client()
    receiver.answer(key)
    asker.sleep(SHORT)
    for tears in KINDS_OF_TEARS:
        torn = damaged(key, question, tears)
        net.damage(question, torn)
        asker.ask(key, question, "torn question")
        (query,) = received(receiver, 1, Query)
        assert query.key == key
        assert query.payload == torn
        assert refusal_of(query.payload, Recall) == "malformed"
        query.refuse("malformed")
        ends = [Replied("torn question", b"", "malformed"), Final("torn question")]
        assert received(asker, 2, Replied | Final) == ends

        torn = damaged(key, reply, tears, is_reply=True)
        net.damage(reply, torn)
        asker.ask(key, question, "torn reply")
        (query,) = received(receiver, 1, Query)
        assert query.payload == question
        query.reply(reply)
        query.drop()
        ends = [Replied("torn reply", torn, ""), Final("torn reply")]
        assert received(asker, 2, Replied | Final) == ends
        assert refusal_of(torn, Recalled) == "malformed"
        net.heal()
    assert is_silent(asker)
    assert is_silent(receiver)


@on_both
def test_a_large_payload_changes_in_its_middle_only(net):
    """The payload keeps its length, and a small one that follows stays behind it."""
    sender = net.client()
    receiver = net.client()
    receiver.subscribe("a")
    wait_until(sender, lambda: sender.is_heard("a"))
    rest = b"." * LARGE
    net.damage(b"MARKED BYTES", b"OTHER  BYTES")
    sender.publish("a", b"MARKED BYTES" + rest)
    sender.publish("a", b"small")
    payloads = [sample.payload for sample in received(receiver, 2)]
    assert payloads == [b"OTHER  BYTES" + rest, b"small"]


@on_both
def test_of_a_payload_that_breaks_off_nothing_arrives(net):
    """The link breaks within the payload. After the session is back, the next one arrives whole."""
    sender = net.client()
    receiver = net.client()
    sender.watch("alive/x/*")
    receiver.declare_alive("alive/x/1")
    received(sender, 1, Alive)
    receiver.subscribe("a")
    wait_until(sender, lambda: sender.is_heard("a"))
    net.break_within(sender, "a", b"MARKED BYTES" + b"." * LARGE, b"MARKED BYTES")
    assert received(sender, 2, Alive) == [Alive("alive/x/1", False), Alive("alive/x/1", True)]
    wait_until(sender, lambda: sender.is_heard("a"))
    sender.publish("a", b"next")
    assert [sample.payload for sample in received(receiver, 1)] == [b"next"]
