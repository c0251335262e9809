"""The inbox of a session: nothing that several threads put there is lost."""

import threading

from patience import PATIENCE

from orchard.net.bus import Alive, Inbox, Sample, Signal


def ends_in_threads(work, threads=1):
    """Run a function in several threads. Return whether all of them end."""
    started = [threading.Thread(target=work, daemon=True) for _ in range(threads)]
    for thread in started:
        thread.start()
    for thread in started:
        thread.join(PATIENCE)
    return not any(thread.is_alive() for thread in started)


def test_a_short_wait_ends_although_it_was_rung_before():
    """Each item that is put wakes the reader. If that item was taken without a wait, its wake-up is
    left over. The next wait must still end, and find nothing.

    Waits of 0 to 29 microseconds end before, while and after the thread gets the processor.
    """
    inbox = Inbox()

    def take() -> None:
        for number in range(30_000):
            inbox.put(Signal(number))
            assert inbox.take() == Signal(number)
            assert inbox.take(1e-6 * (number % 30)) is None

    assert ends_in_threads(take)


def test_items_of_several_threads_all_arrive():
    inbox = Inbox()
    taken = []
    putters = 4
    items = 5000

    def put() -> None:
        for number in range(items):
            inbox.put(Signal(number))

    def take() -> None:
        for _ in range(putters * items):
            taken.append(inbox.take(PATIENCE))

    reader = threading.Thread(target=take, daemon=True)
    reader.start()
    assert ends_in_threads(put, putters)
    reader.join(PATIENCE)
    assert sorted(taken) == sorted([Signal(number) for number in range(items)] * putters)


def test_an_inbox_that_is_emptied_keeps_only_requests_to_end():
    """15 is SIGTERM: a process that is asked to end must end, whatever else it forgets.

    Samples of every key belong to the session before, and are dropped.
    """
    inbox = Inbox()
    inbox.put(Sample("orchard/end", b""))
    inbox.put(Signal(15))
    inbox.put(Alive("orchard/alive/physics/run1/a", True))
    inbox.forget()
    assert inbox.take(0.0) == Signal(15)
    assert inbox.take(0.0) is None
