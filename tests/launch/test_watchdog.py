"""A process that is frozen is ended, one that starts is not."""

from orchard.launch.supervisor import SECONDS as FROZEN_SECONDS
from orchard.launch.supervisor import Watchdog


class OneProcess:
    """A fleet of one."""

    def __init__(self) -> None:
        self.number, self.killed, self.now = 1, [], 0.0

    def clock(self) -> float:
        return self.now

    def pid(self, name: str) -> int:
        return self.number

    def kill(self, name: str) -> None:
        self.killed.append(self.number)


def test_a_process_is_ended_when_its_token_is_gone_for_too_long_and_not_while_it_starts():
    fleet = OneProcess()
    watchdog = Watchdog(fleet, "logger")
    fleet.now = 100.0
    watchdog.look()
    assert fleet.killed == [], "it has not been there yet"
    watchdog.hear(True)
    watchdog.hear(False)
    fleet.now += FROZEN_SECONDS - 0.1
    watchdog.look()
    watchdog.hear(True)
    fleet.now += FROZEN_SECONDS
    watchdog.look()
    assert fleet.killed == [], "it came back"
    watchdog.hear(False)
    fleet.now += FROZEN_SECONDS
    watchdog.look()
    assert fleet.killed == [1]
    fleet.number = 2
    fleet.now += 10 * FROZEN_SECONDS
    watchdog.look()
    assert fleet.killed == [1], "the next one starts"
    watchdog.end()
    assert fleet.killed == [1, 2], "a process that is away at the end is not waited for"
