"""What came of each step: counted, and told to those who look on."""

from typing import TYPE_CHECKING, NamedTuple

from orchard.agent import Action
from orchard.camera import Camera
from orchard.lockstep import Ledger
from orchard.wire.translate import picture_of
from processes.account import Account
from processes.announcer import Announcer
from processes.tally import Tally

if TYPE_CHECKING:
    from orchard.engine import Engine
    from orchard.events import Event


class Step(NamedTuple):
    """What was done at a tick, and what happened."""

    tick: int
    events: "list[Event]"
    actions: dict[str, Action]


class Chronicle:
    """Tells of each step when there is time for it: while the agents think about the next one."""

    def __init__(self, engine: "Engine", account: Account, announcer: Announcer, ledger: Ledger, tally: Tally) -> None:
        self._engine, self._announcer, self._ledger, self._tally = engine, announcer, ledger, tally
        self.account, self.camera = account, Camera(engine.world)
        self._stepped: Step | None = None  # that is not yet told of

    def begin(self) -> None:
        """The first tick begins now."""
        self.account.begin()
        self._say_figures()

    def stepped(self, step: Step) -> None:
        """To be told of at the next `tell`."""
        self._stepped = step

    def tell(self) -> None:
        """Tell and count what came of the last step, once."""
        if self._stepped is None:
            return
        (tick, events, actions), self._stepped = self._stepped, None
        self.account.update(events, actions)
        self._announcer.happened(tick, events)
        self._announcer.wrote(tick, self._ledger.letters.get(tick, {}))
        if self._announcer.is_heard("picture"):
            self._announcer.say("picture", picture_of(self._announcer.run, self.camera.frame(self._engine.scans, actions, events)))
        if self.account.is_due():
            self._say_figures()

    def _say_figures(self) -> None:
        self._announcer.say("figures", self.account.message(self._announcer.run, self._tally.total()))
