"""What a user had entered before a preset, a file or a link took its place: Undo and Redo."""

from dataclasses import dataclass, field
from typing import NamedTuple

from orchard.app.draft import Draft

#: Of such steps, the last ones are kept.
MOST_STEPS = 20


class PutAway(NamedTuple):
    """One replacement. `draft`: what it put away. `name`: of what it put in place."""

    draft: Draft
    name: str


@dataclass
class Replaced:
    """The steps that can be taken back, the last one at the end, and those that were.

    Undo and Redo lose nothing: each keeps what it puts away, also what was typed meanwhile.
    """

    undoable: list[PutAway] = field(default_factory=list)
    redoable: list[PutAway] = field(default_factory=list)

    def replace(self, before: Draft, name: str) -> None:
        """Keep what is replaced by something of this name."""
        self.undoable = [*self.undoable, PutAway(before, name)][-MOST_STEPS:]
        self.redoable = []

    def undo(self, now: Draft) -> Draft:
        """Return what the last step has put away, and keep what is entered now for Redo.

        Raises IndexError if there is no step.
        """
        step = self.undoable.pop()
        self.redoable.append(PutAway(now, step.name))
        return step.draft

    def redo(self, now: Draft) -> Draft:
        """Return what the last Undo has put away, and keep what is entered now for Undo.

        Raises IndexError if nothing was undone.
        """
        step = self.redoable.pop()
        self.undoable.append(PutAway(now, step.name))
        return step.draft
