"""The process in which a policy of the benchmark runs.

It imports the policy's module once. For each harvest it forks a process, which makes a new object
of the policy's class and asks it. So a policy cannot know what happened in another harvest. The
other side is `orchard.study.benchmark.asked`, and `exchange` has the messages.
"""

import os
import resource
import signal
from contextlib import suppress
from pathlib import Path
from typing import BinaryIO

import msgspec

from orchard.behaviour.dispatcher import PolicyFault
from orchard.event_model.policies import AskedPolicy
from orchard.field.layout import lay_out
from orchard.field.plugins import MISTAKES, fault_words, import_own, reraise_ctrl_c
from orchard.field.problems import ScenarioError
from orchard.field.scenario import Scenario
from orchard.study.benchmark.confined import confine, drop_rights, limit
from orchard.study.benchmark.exchange import (
    Ask,
    Begin,
    Done,
    Fault,
    Gone,
    Load,
    Orders,
    Ready,
    Spent,
    framed,
    next_question,
)
from orchard.study.benchmark.seen import layout_seen

# Exit code of a harvest's process that has come to its regular end. A policy that ends the process
# itself is unlikely to choose the same.
OWN_END = 77
# Bytes of data of the process, at most: 4 GiB, which today's laptops have.
MOST_MEMORY = 4 * 2**30
# Processor time, s: so long after the signal of its limit a process is killed that ignores it.
DEAF_SECONDS = 1
# Characters of the version of a policy.
LONGEST_VERSION = 100


def main() -> None:
    """Answer the questions that come over stdin, on stdout, until there are no more.

    What a policy prints goes to stderr.
    """
    # The pipes get other numbers. Then 0 is empty, and 1 is stderr: what the policy reads from
    # stdin or prints to stdout cannot disturb the exchange.
    questions = os.fdopen(os.dup(0), "rb", buffering=0)
    answers = os.fdopen(os.dup(1), "wb", buffering=0)
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    os.dup2(2, 1)
    drop_rights()
    limit(resource.RLIMIT_DATA, MOST_MEMORY)
    limit(resource.RLIMIT_CORE, 0)
    while (question := next_question(questions)) is not None:
        if isinstance(question, Load):
            confine([Path(name) for name in question.hidden])
            # An error of the module comes again when the first harvest makes the policy, and is
            # reported then.
            with suppress(MISTAKES):
                import_own(question.policy.replace(":", ".").rpartition(".")[0])
        elif isinstance(question, Begin):
            _in_fork(question, questions, answers)


def _in_fork(begin: Begin, questions: BinaryIO, answers: BinaryIO) -> None:
    """Let a process of its own answer the questions of a harvest."""
    scenario = Scenario.model_validate_json(begin.scenario)
    # The layout stays in the cache of this process, so the fork, and the next ones, begin sooner.
    lay_out(scenario)
    child = os.fork()
    if child == 0:
        drop_rights()
        limit(resource.RLIMIT_CPU, begin.processor_seconds, DEAF_SECONDS)
        with suppress(BrokenPipeError):
            _harvest(scenario, questions, answers)
        os._exit(OWN_END)
    _, status, used = os.wait4(child, 0)
    code = os.waitstatus_to_exitcode(status)
    # The limit is one of each process alone. How much a process has used together with those that
    # it forked and waited for is known at its end only.
    is_spent = used.ru_utime + used.ru_stime > begin.processor_seconds
    if code == -signal.SIGXCPU or (is_spent and code == OWN_END):
        answers.write(framed(Spent(begin.processor_seconds)))
    elif code == OWN_END:
        answers.write(framed(Done()))
    else:
        answers.write(framed(Gone(code)))


def _harvest(scenario: Scenario, questions: BinaryIO, answers: BinaryIO) -> None:
    """Answer the questions of a harvest, until it ends or the policy makes a fault."""
    try:
        policy = AskedPolicy(layout_seen(scenario))
    except ScenarioError as error:
        answers.write(framed(Fault("\n".join(problem.text for problem in error.problems))))
        return
    try:
        version = str(getattr(policy.policy, "version", ""))[:LONGEST_VERSION]
    except MISTAKES as error:
        reraise_ctrl_c(error)
        fault = f"its `version` cannot be read: {fault_words(error)}"
        answers.write(framed(Fault(f"cannot be used: {fault}")))
        return
    answers.write(framed(Ready(policy.is_early, version)))
    while isinstance(question := next_question(questions), Ask):
        try:
            orders = policy.orders(question.now, question.bins, question.carriers)
            answer = framed(Orders(orders))
        except (PolicyFault, msgspec.MsgspecError) as fault:
            answers.write(framed(Fault(str(fault))))
            return
        answers.write(answer)


if __name__ == "__main__":
    main()
