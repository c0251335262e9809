"""An agent without a body, and a message of its own: pickers report, a counter sums up.

agents: {picker: examples.seams.bin_counter.CountingPicker}
agents_without_body: {counter: examples.seams.bin_counter.Counter}"""

from orchard import Action, AgentMessage, Picker


class Progress(AgentMessage, frozen=True):
    steps: int


class Counter:
    Memory, Messages = dict[str, int], (Progress,)

    def __init__(self, layout, name): ...

    def tick(self, observation, mail, memory):
        memory = (memory or {}) | {heard.sender: heard.body.steps for heard in mail.requests}
        answers = [(heard, Progress(sum(memory.values()))) for heard in mail.requests]
        return Action(answers=answers, memory=memory, doing="counting")


class CountingPicker(Picker):
    Messages = (Progress,)

    def tick(self, observation, mail, memory):
        action = super().tick(observation, mail, memory)
        action.requests.append(("counter", Progress(action.steps_done)))
        return action
