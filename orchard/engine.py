"""The step that every mode shares: look, act, account. Local mode and the physics process differ only in who brings the actions."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from orchard.agent import Action
from orchard.config import Scenario
from orchard.digest import RunDigest
from orchard.doer import TRAFFIC
from orchard.events import Event
from orchard.layout import lay_out
from orchard.messages import Deed
from orchard.observe import observe
from orchard.physics import harvest_is_over, step
from orchard.scan import Scanner
from orchard.sights import Sights
from orchard.snapshot import Snapshot
from orchard.thaw import world_as_data, world_from
from orchard.world import World, new_world


class Engine:
    """One orchard on its way through the ticks: `observe()` once per tick, then `advance()` with what the agents answered.

    A body without an action stands still. Actions count by name and are applied in the layout's order, never in that of arrival.
    """

    def __init__(self, world: World, digest: bytes = bytes(32)) -> None:
        self.world, self.layout = world, world.layout
        self.agents = (*self.layout.names, TRAFFIC)  # every name that an agent can hold
        self.scans: list[np.ndarray] = []  # m, float32: of the tick that was last observed, one array per body
        self._scanner = Scanner(self.layout)
        self._digest = RunDigest(digest)

    @classmethod
    def begin(cls, scenario: Scenario) -> "Engine":
        """An orchard at tick 0."""
        return cls(new_world(lay_out(scenario)))

    @classmethod
    def resume(cls, snapshot: Snapshot) -> "Engine":
        """The orchard of a snapshot."""
        return cls(world_from(snapshot), snapshot.digest)

    def as_data(self) -> dict[str, Any]:
        """The world, as a snapshot holds it."""
        return world_as_data(self.world)

    @property
    def tick(self) -> int:
        return self.world.tick

    @property
    def over(self) -> bool:
        """Every row is picked, every full bin unloaded, and the carriers are back in the queue."""
        return harvest_is_over(self.world)

    @property
    def digest(self) -> bytes:
        """What the hash must remember."""
        return self._digest.state

    @property
    def hash(self) -> str:
        """SHA-256 over all ticks so far."""
        return self._digest.hexdigest()

    def observe(self) -> Sights:
        """What each body sees at this tick."""
        self.scans = self._scanner.scan(self.world)
        return observe(self.world, self.scans)

    def advance(self, actions: Mapping[str, Action], mail_digests: Mapping[str, bytes]) -> list[Event]:
        """Apply the answers to this tick, 0.1 s long, and account for it: its scans and mail, and the state that came of it."""
        events = step(self.world, self._twists(actions), self._deeds(actions))
        self._digest.update(self.world, self.scans, self._heard(mail_digests))
        return events

    def _heard(self, mail_digests: Mapping[str, bytes]) -> dict[str, bytes]:
        """The digests of what was heard; what is written to nobody is not."""
        return {name: mail_digests[name] for name in self.agents if mail_digests.get(name)}

    def _twists(self, actions: Mapping[str, Action]) -> np.ndarray:
        twists = np.zeros((len(self.layout.starts), 3))
        for i, name in enumerate(self.layout.names):
            if name in actions:
                twists[i] = actions[name].twist
        return twists

    def _deeds(self, actions: Mapping[str, Action]) -> list[tuple[int, Deed]]:
        return [(i, deed) for i, name in enumerate(self.layout.names) if name in actions for deed in actions[name].deeds]
