"""Undo and Redo of what presets, files and links have put away."""

from orchard.app.draft import Draft
from orchard.app.replaced import MOST_STEPS, Replaced
from orchard.field.scenario import Scenario

OWN = Draft(Scenario(rows=12))
FIRST = Draft(Scenario(rows=26))
SECOND = Draft(Scenario(rows=40))


def test_own_rows_come_back_after_two_presets():
    """Somebody looks at one preset, then at another one, and wants back to the rows typed first."""
    replaced = Replaced()
    replaced.replace(OWN, "Hand picking")
    replaced.replace(FIRST, "Kiwi robot")
    assert replaced.undoable[-1].name == "Kiwi robot"
    assert replaced.undo(SECOND) is FIRST
    assert replaced.undoable[-1].name == "Hand picking"
    assert replaced.undo(FIRST) is OWN
    assert replaced.undoable == []


def test_what_was_typed_into_a_preset_is_redone():
    replaced = Replaced()
    replaced.replace(OWN, "Hand picking")
    typed = Draft(Scenario(rows=27))
    assert replaced.undo(typed) is OWN
    assert replaced.redo(OWN) is typed
    assert replaced.undo(typed) is OWN


def test_another_preset_ends_what_can_be_redone():
    replaced = Replaced()
    replaced.replace(OWN, "Hand picking")
    replaced.undo(FIRST)
    replaced.replace(OWN, "Kiwi robot")
    assert replaced.redoable == []
    for _ in range(MOST_STEPS + 1):
        replaced.replace(FIRST, "Default")
    assert len(replaced.undoable) == MOST_STEPS
