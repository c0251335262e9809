"""An agent on a host, with its memory. Physics keeps a copy of the memory as bytes.

If the host dies, the next host of the agent goes on with that copy.
"""

import logging
from typing import Any

from orchard.contract.agent import Action, Mail, Observation
from orchard.contract.guard import Guard
from orchard.contract.messages import unpack
from orchard.field.plugins import MISTAKES, reraise_ctrl_c
from orchard.field.problems import printable

log = logging.getLogger("orchard")


class AgentRunner:
    """An agent and its memory."""

    def __init__(self, name: str, agent: Guard) -> None:
        self.name = name
        self._agent = agent
        self.memory: Any = None
        # The packed memory that physics has.
        self._sent: bytes | None = None

    def resume(self, memory: bytes | None) -> None:
        """Continue with the memory that physics has; None: without one.

        The agent goes on without one, too, if the memory does not fit its `Memory`.
        """
        self.memory = None
        self._sent = memory
        if memory is None:
            return
        try:
            self.memory = unpack(memory, self._agent.Memory)
        except MISTAKES as error:
            reraise_ctrl_c(error)
            why = f"its last one is not of its class: {printable(str(error))}"
            log.warning("%s starts without a memory; %s", self.name, why)

    def act(self, seen: Observation, mail: Mail) -> Action:
        """Return what the agent does, and keep its memory."""
        action = self._agent.tick(seen, mail, self.memory)
        self.memory = action.memory
        return action

    def news(self) -> bytes | None:
        """Return the packed memory to send; None if physics has it already.

        Call it once after each `act`: it counts as sent.
        """
        before = self._sent
        self._sent = self._agent.packed
        if self._sent == before:
            return None
        return self._sent
