"""The processes of a run: physics, agents, logger, router. Each file is a command line, for `python -m orchard.processes.NAME`."""

from orchard.memory import collect_seldom

collect_seldom()
