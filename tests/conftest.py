"""Tests import each other's helpers (`stage`, `raycaster`) by name. Whatever test runs an orchard, its invariants hold at every tick."""

import sys
from pathlib import Path

import pytest

from orchard.engine import Engine

sys.path.insert(0, str(Path(__file__).parent))


@pytest.fixture(autouse=True)
def invariants_hold(monkeypatch):
    """Whoever runs an engine in this process: the first tick after which an invariant is broken fails the test."""
    advance = Engine.advance

    def advance_and_look(self, actions, mail_digests):
        events = advance(self, actions, mail_digests)
        assert self.invariants.violations == []
        return events

    monkeypatch.setattr(Engine, "advance", advance_and_look)
