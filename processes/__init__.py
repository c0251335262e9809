"""The processes of a run: physics, agents, logger, router: `python -m orchard.processes.NAME`."""

from orchard.memory import collect_seldom

collect_seldom()
