"""The side of the benchmark that asks a user's policy, which runs in a process of its own.

A policy must not learn what the seed draws, and must not stop the benchmark. So its process gets
the name of its module, a few variables of the environment, and two pipes, through which it is asked
(`orchard.study.benchmark.exchange`). For each harvest it forks a process; the messages `Gone` and
`Spent` say that this one has ended too early. Other processes of the same user cannot read the
memory of the benchmark's process.
"""

import ctypes
import os
import selectors
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from types import TracebackType

from orchard.behaviour.dispatcher import PolicyFault, checked
from orchard.dispatch.policy import Assignment, BinReport, CarrierReport
from orchard.field.problems import printable
from orchard.field.scenario import Scenario, with_changes
from orchard.start_module import command_for
from orchard.study.benchmark.exchange import (
    HEAD_BYTES,
    LARGEST_ANSWER,
    Answer,
    Ask,
    Begin,
    Done,
    Fault,
    Gone,
    Load,
    Orders,
    Over,
    Question,
    Ready,
    Spent,
    answer_of,
    framed,
)
from orchard.study.benchmark.seen import nothing_drawn

# Time by the clock that a decision may take, s.
DECISION_SECONDS = 1.0
# Time by the clock until a policy can be asked, s: it may import a library for learning, which
# takes long to load.
BEGIN_SECONDS = 120.0
# Processor time that a policy may take in a whole harvest, s. A decision of `rolling` takes some
# 10 ms, and a harvest has hundreds.
HARVEST_PROCESSOR_SECONDS = 120
# s between two looks whether to stop.
GLANCE = 0.2
# Variables of the environment that a policy's process gets.
ENVIRONMENT = (
    "HOME",
    "LANG",
    "LC_ALL",
    "LD_LIBRARY_PATH",
    "NUMBA_CACHE_DIR",
    "OMP_NUM_THREADS",
    "PATH",
    "TMPDIR",
    "VIRTUAL_ENV",
)
_MODULE = "orchard.study.benchmark.policy_process"
# PR_SET_DUMPABLE of Linux, for prctl: with 0 other processes cannot read this one's memory.
_SET_DUMPABLE = 4


class TooSlow(Exception):
    """Raised for a decision that takes longer than it may."""


class AskingStopped(Exception):
    """Raised when the benchmark is stopped while a policy is asked."""


class PolicyRefused(Exception):
    """Raised for a policy that cannot be made: the text says why, and where in the user's file."""


@dataclass(frozen=True)
class Limits:
    """How long a policy may take, and which files it may not read: see the constants above."""

    decision_seconds: float = DECISION_SECONDS
    begin_seconds: float = BEGIN_SECONDS
    processor_seconds: int = HARVEST_PROCESSOR_SECONDS
    #: Files that it may not read.
    hidden: tuple[str, ...] = ()


class PolicyProcess:
    """The process of a policy. It begins with the first harvest, and anew after each fault."""

    def __init__(
        self, policy: str, limits: Limits, is_stopped: Callable[[], bool] = lambda: False
    ) -> None:
        """`policy`: its name in a scenario. `is_stopped`: whether its answers are not needed any
        more.
        """
        self.policy = policy
        self._limits = limits
        self._is_stopped = is_stopped
        self._process: subprocess.Popen[bytes] | None = None
        # Of the last question, for messages.
        self._tick = 0
        # The attribute `version` of the policy's class, once a harvest has begun.
        self.version = ""

    def __enter__(self) -> "PolicyProcess":
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.stop()

    def begin(self, scenario: Scenario) -> bool:
        """Begin a harvest. Return whether bins report before they are full.

        Raises PolicyRefused, PolicyFault, TooSlow or AskingStopped.
        """
        if self._process is None:
            self._start()
            load = Load(self.policy, [*self._limits.hidden])
            self._tell(load, self._limits.begin_seconds, "to begin")
        seen = with_changes(nothing_drawn(scenario), dispatch=self.policy)
        self._tick = 0
        begin = Begin(seen.model_dump_json(), self._limits.processor_seconds)
        answer = self._answer(begin, self._limits.begin_seconds, "to begin")
        if isinstance(answer, Fault):
            # The harvest's process has ended. The policy's process begins anew for the next one.
            self.stop()
            raise PolicyRefused(printable(answer.text, 1000))
        if not isinstance(answer, Ready):
            raise self._fault("it gave no answer of a policy when it began")
        self.version = printable(answer.version)
        return answer.is_early

    def orders(
        self, now: int, bins: Sequence[BinReport], carriers: Sequence[CarrierReport]
    ) -> list[Assignment]:
        """Return what the policy decides at a tick.

        Raises PolicyFault, TooSlow or AskingStopped.
        """
        self._tick = now
        ask = Ask(now, list(bins), list(carriers))
        answer = self._answer(ask, self._limits.decision_seconds, "for a decision")
        if isinstance(answer, Fault):
            self.stop()
            raise PolicyFault(printable(answer.text, 1000))
        if not isinstance(answer, Orders):
            raise self._fault("its process gave another answer than orders")
        try:
            return checked(answer.orders, list(bins), list(carriers))
        except (TypeError, ValueError) as error:
            raise self._fault(str(error)) from None

    def end(self) -> None:
        """End the harvest. Raises PolicyFault, TooSlow or AskingStopped."""
        answer = self._answer(Over(), self._limits.begin_seconds, "to end")
        if not isinstance(answer, Done):
            raise self._fault("it gave another answer than that it is done")

    def stop(self) -> None:
        """End the process, with all that it has started in its group."""
        if self._process is None:
            return
        with suppress(ProcessLookupError):
            os.killpg(self._process.pid, signal.SIGKILL)
        self._process.wait()
        # A process that it started outside its group may still hold the other ends of its pipes.
        for pipe in (self._process.stdin, self._process.stdout):
            if pipe is not None:
                with suppress(BrokenPipeError):
                    pipe.close()
        self._process = None

    def _start(self) -> None:
        """Start the process, in a group of its own."""
        hide_memory()
        environment = {name: os.environ[name] for name in ENVIRONMENT if name in os.environ}
        # It finds the modules that this process finds.
        environment["PYTHONPATH"] = os.pathsep.join(path for path in sys.path if path)
        self._process = subprocess.Popen(
            command_for(_MODULE, []),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env=environment,
            bufsize=0,
            start_new_session=True,
        )
        assert self._process.stdin is not None
        # Writing must not block: a policy that reads no questions would stop the benchmark.
        os.set_blocking(self._process.stdin.fileno(), False)

    def _answer(self, question: Question, seconds: float, purpose: str) -> Answer:
        """Return the answer to a question.

        `seconds`: that it may take. `purpose`: what takes the time, for messages: "for a decision".
        Raises PolicyFault, TooSlow or AskingStopped.
        """
        if self._has_written():
            # `Gone` or `Spent` comes without a question: `_next_answer` raises for both.
            self._next_answer(seconds, purpose)
            raise self._fault("it gave an answer before it was asked")
        self._tell(question, seconds, purpose)
        return self._next_answer(seconds, purpose)

    def _has_written(self) -> bool:
        """Return whether something can be read from the process."""
        assert self._process is not None and self._process.stdout is not None
        with selectors.DefaultSelector() as selector:
            selector.register(self._process.stdout, selectors.EVENT_READ)
            return bool(selector.select(0.0))

    def _tell(self, question: Question, seconds: float, purpose: str) -> None:
        """Send a question. If the process has ended, `_next_answer` notices that.

        Raises TooSlow if the process does not read it in time, and AskingStopped.
        """
        assert self._process is not None and self._process.stdin is not None
        pipe = self._process.stdin.fileno()
        until = time.monotonic() + seconds
        left = framed(question)
        while left:
            self._wait_for(pipe, selectors.EVENT_WRITE, until, self._too_slow(seconds, purpose))
            try:
                left = left[os.write(pipe, left) :]
            except BrokenPipeError:
                return

    def _next_answer(self, seconds: float, purpose: str) -> Answer:
        """Return the next answer of the process. Raises PolicyFault, TooSlow or AskingStopped."""
        until = time.monotonic() + seconds
        too_slow = self._too_slow(seconds, purpose)
        size = int.from_bytes(self._read(HEAD_BYTES, until, too_slow), "big")
        if size > LARGEST_ANSWER:
            raise self._fault(f"its answer has {size} bytes; at most {LARGEST_ANSWER}")
        try:
            answer = answer_of(self._read(size, until, too_slow))
        except ValueError as error:
            raise self._fault(f"its process wrote no answer of a policy: {error}") from None
        if isinstance(answer, Spent):
            self.stop()
            raise TooSlow(
                f"dispatch policy {self.policy}, tick {self._tick}: it took more than"
                f" {answer.processor_seconds} s of the processor for one harvest"
            )
        if isinstance(answer, Gone):
            raise self._fault(f"it ended its process, with code {answer.code}")
        return answer

    def _read(self, size: int, until: float, too_slow: TooSlow) -> bytes:
        """Return so many bytes of an answer.

        Raises `too_slow`, AskingStopped, or PolicyFault at its end.
        """
        assert self._process is not None and self._process.stdout is not None
        pipe = self._process.stdout.fileno()
        content = b""
        while len(content) < size:
            self._wait_for(pipe, selectors.EVENT_READ, until, too_slow)
            part = os.read(pipe, size - len(content))
            if not part:
                raise self._fault("its process ended")
            content += part
        return content

    def _wait_for(self, pipe: int, event: int, until: float, too_slow: TooSlow) -> None:
        """Wait until a pipe can be read, or written.

        Raises `too_slow` or AskingStopped, and ends the process.
        """
        with selectors.DefaultSelector() as selector:
            selector.register(pipe, event)
            while True:
                if self._is_stopped():
                    self.stop()
                    raise AskingStopped
                left = until - time.monotonic()
                is_ready = bool(selector.select(min(GLANCE, max(0.0, left))))
                # This process may have been suspended meanwhile, by the policy too. Then an answer
                # is ready that came too late.
                is_late = time.monotonic() > until
                if is_ready and not is_late:
                    return
                if is_late:
                    self.stop()
                    raise too_slow

    def _too_slow(self, seconds: float, purpose: str) -> TooSlow:
        return TooSlow(
            f"dispatch policy {self.policy}, tick {self._tick}: it took more than {seconds:g} s"
            f" {purpose}"
        )

    def _fault(self, text: str) -> PolicyFault:
        """Return the error for an answer that cannot be, and end the process."""
        self.stop()
        return PolicyFault(f"dispatch policy {self.policy}, tick {self._tick}: {text}")


def hide_memory() -> None:
    """Keep other processes of this user from reading this one's memory. Only Linux can do that."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_SET_DUMPABLE, 0, 0, 0, 0)
