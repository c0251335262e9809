"""What physics is asked, and its replies: the scenario, a wish to join, mail to recall, an emergency stop, the command to end."""

from collections.abc import Callable
from functools import partial

from orchard.contract.messages import pack
from orchard.net.bus import Query
from orchard.net.refusals import Refused, read_message, refuse_other_tick
from orchard.server.harvest import Harvest, RunEnded
from orchard.server.snapshots import KEPT_SECONDS
from orchard.sim.stops import stopped
from orchard.wire.keys import Keys
from orchard.wire.messages import Command, Done, Join, Joined, Recall, Recalled, RunInfo, Stop, Stopped


class Queries:
    """Replies to what is asked of a run."""

    def __init__(self, keys: Keys, harvest: Harvest) -> None:
        self._keys, self._harvest = keys, harvest
        self._replies = {"scenario": self._tell, "recall": self._recall, "stop": self._stop, "command": self._obey}

    def asked(self) -> list[str]:
        """The keys on which it is asked."""
        return [self._keys.of(what) for what in (*self._replies, "join")]

    def reply(self, question: Query) -> None:
        """Answer a query. Nonsense gets an error, and raises Refused."""
        try:
            self._reply_to(question.key)(question)
        except Refused as refusal:
            question.refuse(str(refusal))
            raise
        question.drop()

    def _reply_to(self, key: str) -> Callable[[Query], None]:
        """What replies on a key. Raises Refused for one that means no single key."""
        match self._keys.parts(key):
            case [what] if what in self._replies:
                return self._replies[what]
            case ["hosts", session, "join"]:
                return partial(self._join, session)
        raise Refused("no such key")

    def _tell(self, question: Query) -> None:
        if question.payload:
            raise Refused("malformed", "the scenario query has no payload")
        engine, drivers = self._harvest.engine, self._harvest.drivers
        scenario = engine.layout.scenario.model_dump()
        question.reply(pack(RunInfo(self._harvest.run, engine.tick, drivers.answers.mode, list(drivers.roster.names), scenario)))

    def _join(self, session: str, question: Query) -> None:
        """Let a host hold all the agents that it names, or none. That nobody asks on another's key, a secured router sees to."""
        join = read_message(question.payload, Join, self._harvest.run)
        if join.holder != session:
            raise Refused("not the holder", f"{join.holder!r} is not the session of the key")
        drivers = self._harvest.drivers
        refused = drivers.join(join.names, join.holder)
        held = [] if refused else join.names
        memories = {name: drivers.ledger.memories.get(name) for name in held}
        question.reply(pack(Joined(self._harvest.run, self._harvest.engine.tick, memories, refused)))
        drivers.expect(held, join.holder)

    def _recall(self, question: Query) -> None:
        """Tell a host the letters of the last two ticks."""
        recall, tick = read_message(question.payload, Recall, self._harvest.run), self._harvest.engine.tick
        refuse_other_tick(recall.tick, tick, tick)
        question.reply(pack(Recalled(self._harvest.run, tick, sorted(self._harvest.drivers.ledger.letters.items()))))

    def _stop(self, question: Query) -> None:
        """Latch or reset an emergency stop; the engine sees to it that nothing outranks it. The answer tells whether it is kept."""
        harvest, engine = self._harvest, self._harvest.engine
        wish = read_message(question.payload, Stop, harvest.run)
        harvest.reporter.tell()
        try:
            changed = engine.stop(wish.names) if wish.stop else engine.reset(wish.names)
        except ValueError as error:
            raise Refused("no such robot", str(error)) from error
        if changed and harvest.has_begun:
            harvest.keep()
        kept = harvest.has_begun and harvest.snapshot_writer.finish(KEPT_SECONDS)
        question.reply(pack(Stopped(harvest.run, engine.tick, changed, stopped(engine.world), kept)))

    def _obey(self, question: Query) -> None:
        command = read_message(question.payload, Command, self._harvest.run)
        question.reply(pack(Done(self._harvest.run, self._harvest.engine.tick)))
        question.drop()
        raise RunEnded(f"{command.command}ped")
