"""The processes of a run: physics, agents, logger, router: `python -m orchard.processes.NAME`."""

from orchard.memory import collect_seldom

# In each of them the garbage collector runs seldom.
collect_seldom()
