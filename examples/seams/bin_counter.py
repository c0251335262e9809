"""An agent without a body, and a message of its own: pickers report, a counter sums up.

agents: {picker: examples.seams.bin_counter.CountingPicker}
agents_without_body: {counter: examples.seams.bin_counter.Counter}"""

from orchard import Action, AgentMessage, Picker


class Progress(AgentMessage, frozen=True):
    steps: int


class Counter:
    Memory = dict[str, int]  # picker -> the steps that it has done
    Messages = (Progress,)

    def __init__(self, layout, name): ...

    def tick(self, observation, mail, memory):
        memory = dict(memory or {})
        for heard in mail.requests:
            memory[heard.sender] = heard.body.steps
        total = Progress(sum(memory.values()))
        answers = [(heard, total) for heard in mail.requests]
        return Action(answers=answers, memory=memory, doing="counting")


class CountingPicker(Picker):
    Messages = (Progress,)

    def tick(self, observation, mail, memory):
        action = super().tick(observation, mail, memory)
        action.requests.append(("counter", Progress(action.steps_done)))
        return action
