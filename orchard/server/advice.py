"""Advice, without a network: another client gives a robot its velocity, and the robot's agent goes on with plan, mail and deeds."""

from collections.abc import Mapping

from msgspec.structs import replace

from orchard.contract.agent import Action
from orchard.net.refusals import refuse_other_tick
from orchard.wire.codec import twist_of
from orchard.wire.messages import Advice

ADVICE_TICKS = 5  # steps that one velocity drives a robot: 0.5 s, as the watchdog of a robot without an owner


class Advised:
    """The newest advice for each robot. It counts by simulated time alone, so a paused or slow run changes nothing."""

    def __init__(self) -> None:
        self._newest: dict[str, Advice] = {}

    def take(self, name: str, advice: Advice, tick: int) -> None:
        """Take advice for a robot at a tick. Raises Refused if it is too old, older than the last one, or of the future."""
        last = self._newest[name].tick if name in self._newest else 0
        refuse_other_tick(advice.tick, max(last, tick - ADVICE_TICKS + 1), tick)
        self._newest[name] = advice

    def actions(self, tick: int, own: Mapping[str, Action], held: Mapping[str, Action]) -> dict[str, Action]:
        """Return the action of each robot that is advised at this tick: that of its agent with another velocity.

        `own`: the actions of this tick; `held`: the newest action of each agent, for one that holds. An agent that is advised does not
        hold: it is asked at the next tick.
        """
        self._newest = {name: advice for name, advice in self._newest.items() if tick - advice.tick < ADVICE_TICKS}
        quiet = {name: replace(held[name], deeds=[], requests=[], answers=[]) for name in self._newest if name in held}
        known = {**quiet, **own}
        return {name: replace(known.get(name) or Action(), twist=twist_of(advice), hold=None) for name, advice in self._newest.items()}
