"""What came of each step: counted, and told to those who look on."""

from typing import TYPE_CHECKING, NamedTuple

from orchard.contract.agent import Action
from orchard.net.recovery import RecoveryLog
from orchard.net.refusals import RefusalTotals
from orchard.server.figures import RunFigures
from orchard.server.publisher import Publisher
from orchard.sim.frames import FrameBuilder
from orchard.wire.codec import picture_of

if TYPE_CHECKING:
    from orchard.contract.events import Event
    from orchard.sim.engine import Engine


class FinishedStep(NamedTuple):
    """What was done at a tick, and what happened."""

    tick: int
    events: "list[Event]"
    actions: dict[str, Action]


class StepReporter:
    """Tells of each step when there is time for it: while the agents think about the next one."""

    def __init__(
        self, engine: "Engine", account: RunFigures, publisher: Publisher, ledger: RecoveryLog, refusal_totals: RefusalTotals
    ) -> None:
        self._engine, self._publisher, self._ledger, self._refusal_totals = engine, publisher, ledger, refusal_totals
        self.account, self.camera = account, FrameBuilder(engine.world)
        self._stepped: FinishedStep | None = None  # that is not yet told of

    def begin(self) -> None:
        """The first tick begins now."""
        self.account.begin()
        self._say_figures()

    def stepped(self, step: FinishedStep) -> None:
        """To be told of at the next `tell`."""
        self._stepped = step

    def tell(self) -> None:
        """Tell and count what came of the last step, once."""
        if self._stepped is None:
            return
        (tick, events, actions), self._stepped = self._stepped, None
        self.account.update(events, actions)
        self._publisher.happened(tick, events)
        self._publisher.wrote(tick, self._ledger.letters.get(tick, {}))
        if self._publisher.is_heard("picture"):
            self._publisher.say("picture", picture_of(self._publisher.run, self.camera.frame(self._engine.scans, actions, events)))
        if self.account.is_due():
            self._say_figures()

    def _say_figures(self) -> None:
        self._publisher.say("figures", self.account.message(self._publisher.run, self._refusal_totals.total()))
