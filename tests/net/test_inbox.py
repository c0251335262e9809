"""What arrives: nothing is lost, and no thread waits longer than it said."""

import threading

from orchard.net.bus import Inbox, Signal

SECONDS = 60.0  # that any of this may take on a busy machine


def run_by(work, threads=1):
    """Whether all of these threads come to an end."""
    started = [threading.Thread(target=work, daemon=True) for _ in range(threads)]
    for thread in started:
        thread.start()
    for thread in started:
        thread.join(SECONDS)
    return not any(thread.is_alive() for thread in started)


def test_a_short_wait_ends_although_it_was_rung_before():
    """A wait that is over before it has begun, because others had the processor, is over."""
    inbox = Inbox()

    def take() -> None:
        for number in range(30_000):
            inbox.put(Signal(number))
            assert inbox.take() == Signal(number)
            assert inbox.take(1e-6 * (number % 30)) is None

    assert run_by(take)


def test_whoever_rings_while_others_do_is_heard():
    inbox, heard = Inbox(), []
    putters = 4

    def take() -> None:
        heard.extend(inbox.take(SECONDS) for _ in range(putters * 5000))

    reader = threading.Thread(target=take, daemon=True)
    reader.start()
    assert run_by(lambda: [inbox.put(Signal(number)) for number in range(5000)], putters)
    reader.join(SECONDS)
    assert sorted(heard) == sorted(Signal(number) for number in range(5000) for _ in range(putters))
