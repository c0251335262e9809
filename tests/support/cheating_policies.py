"""Dispatch policies that try to know, or to do, more than a policy of the benchmark may.

tests/study/benchmark runs each of them as `orchard benchmark` runs a policy of a user: in a process
of its own, with less rights. A policy that finds something raises `Found` with it, so the test
sees what it has found in the message of its error.
"""

import ctypes
import gc
import mmap
import os
import resource
import signal
import subprocess
import sys
import time
from pathlib import Path

from orchard import Assignment

# What a policy may compare to find out which public orchard it harvests.
SIZES = ("rows", "pickers", "carriers", "picking_speed", "row_length", "rows_to_pickers")


class Found(Exception):
    """Raised by a cheat with what it has found."""


class Honest:
    """Sends free carriers to bins in the order of their names."""

    early = True
    Memory = dict

    def __init__(self, layout):
        self.layout = layout

    def assign(self, now, bins, carriers, memory):
        free = [carrier.name for carrier in carriers if carrier.is_next]
        return [
            Assignment(report.name, carrier) for report, carrier in zip(bins, free, strict=False)
        ]


class SeedReader(Honest):
    """Reads the seed of the harvest: from it follows all that is drawn."""

    def __init__(self, layout):
        raise Found(layout.scenario.seed)


class SeedReaderWithDefault(Honest):
    """Reads the seed, and takes its absence for None."""

    def __init__(self, layout):
        raise Found(getattr(layout.scenario, "seed", None))


class FailureReader(Honest):
    """Reads how often carriers fail."""

    def assign(self, now, bins, carriers, memory):
        raise Found(self.layout.scenario.carrying.failure)


class SpeedReader(Honest):
    """Reads the drawn picking speed of each row."""

    def assign(self, now, bins, carriers, memory):
        raise Found(sorted({lane.picking_speed for lane in self.layout.lanes}))


class GuestReader(Honest):
    """Reads which kinds of bodies there are, people and animals among them."""

    def assign(self, now, bins, carriers, memory):
        raise Found(sorted({start.kind for start in self.layout.starts}))


class DumpReader(Honest):
    """Reads what is hidden from the scenario as a map."""

    def __init__(self, layout):
        dump = layout.scenario.model_dump()
        raise Found(dump["seed"], dump["picking"]["spread"], dump["people"])


class StackClimber(Honest):
    """Looks for the harvest among the local variables of the functions that called it."""

    def assign(self, now, bins, carriers, memory):
        names = []
        frame = sys._getframe()
        while frame is not None:
            names += [type(value).__name__ for value in frame.f_locals.values()]
            frame = frame.f_back
        raise Found("EventHarvest" in names, "Benchmark" in names)


class Collector(Honest):
    """Looks for the harvest, and for seeds, among all objects of its process."""

    def assign(self, now, bins, carriers, memory):
        objects = gc.get_objects()
        kinds = {type(found).__name__ for found in objects}
        seeds = {
            found["seed"]
            for found in objects
            if isinstance(found, dict) and type(found.get("seed")) is int
        }
        raise Found("EventHarvest" in kinds, sorted(seeds))


class ModuleReader(Honest):
    """Imports the benchmark, and looks which orchard this is."""

    def __init__(self, layout):
        from orchard.study.benchmark.instances import instances

        raise Found([name for name in instances() if name == "tiny-train"])


class Librarian(Honest):
    """Looks the orchard up among the public ones, and gives the orders of its best schedule."""

    def __init__(self, layout):
        super().__init__(layout)
        from orchard.study.benchmark.instances import instances

        seen = layout.scenario
        self.orders = {}
        for instance in instances().values():
            sizes = [(instance.scenario[key], getattr(seen, key)) for key in SIZES]
            if all(known == here for known, here in sizes):
                for order in instance.draws[0].best.orders:
                    assignment = Assignment(order.bin, order.carrier)
                    self.orders.setdefault(order.tick, []).append(assignment)
                return
        raise Found("no such orchard")

    def assign(self, now, bins, carriers, memory):
        return self.orders.get(now, [])


class MemoryReader(Honest):
    """Looks into the processes above it."""

    def assign(self, now, bins, carriers, memory):
        opened = []
        pid = os.getppid()
        while pid > 1:
            status = Path(f"/proc/{pid}/status").read_text().split()
            name = status[1]
            parent = int(status[status.index("PPid:") + 1])
            for file in ("mem", "environ"):
                try:
                    Path(f"/proc/{pid}/{file}").open("rb").close()
                    opened.append((name, file, pid == os.getppid()))
                except PermissionError:
                    pass
            pid = parent
        raise Found(opened)


def _pid_of_benchmark():
    """Return the id of the process above the one that forked this one.

    The process of a policy is forked by a small one, which the benchmark has started.
    """
    status = Path(f"/proc/{os.getppid()}/status").read_text().split()
    return int(status[status.index("PPid:") + 1])


class MemoryReaderAnew(Honest):
    """Starts another program that looks into the benchmark. Root's begin with all rights."""

    def assign(self, now, bins, carriers, memory):
        program = f"open('/proc/{_pid_of_benchmark()}/mem', 'rb'); print('opened')"
        done = subprocess.run(
            [sys.executable, "-c", program], capture_output=True, text=True, check=False
        )
        raise Found(done.stdout + done.stderr[-200:])


class Stopper(Honest):
    """Would hold the benchmark, and with it the clock of a decision."""

    def assign(self, now, bins, carriers, memory):
        # 0 only asks whether a signal could be sent.
        os.kill(_pid_of_benchmark(), 0)
        raise Found("it can send signals")


class SecretReader(Honest):
    """Reads the file of the secret, and one beside it."""

    def __init__(self, layout):
        folder = Path(os.environ["TMPDIR"])
        texts = [folder.joinpath("beside.txt").read_text()]
        try:
            texts.append(folder.joinpath("secret.txt").read_text())
        except PermissionError:
            texts.append("refused")
        raise Found(texts)


class ArgumentReader(Honest):
    """Looks for words about the orchard in its command line and environment."""

    def assign(self, now, bins, carriers, memory):
        # A policy has the first ones by right; the others say nothing about the orchard.
        wanted = ("PATH", "PYTHONPATH", "HOME", "LANG", "LC_ALL", "TMPDIR", "VIRTUAL_ENV")
        known = (*wanted, "LC_CTYPE", "LD_LIBRARY_PATH", "NUMBA_CACHE_DIR", "OMP_NUM_THREADS")
        rest = sorted(name for name in os.environ if name not in known)
        raise Found(sys.argv[1:], rest)


class Patcher(Honest):
    """Changes the harvest and the clock in its own process, so that harvests seem short."""

    def __init__(self, layout):
        super().__init__(layout)
        from orchard.event_model.harvest import EventHarvest

        EventHarvest.seconds = property(lambda harvest: 1.0)
        EventHarvest.is_over = property(lambda harvest: True)
        time.monotonic = lambda: 0.0


class Sleeper(Honest):
    """Never answers, and uses no processor time."""

    def assign(self, now, bins, carriers, memory):
        time.sleep(3600.0)


class Spinner(Honest):
    """Never answers, and uses all processor time."""

    def assign(self, now, bins, carriers, memory):
        while True:
            pass


class SlowStarter(Honest):
    """Is never done with being made."""

    def __init__(self, layout):
        while True:
            pass


class Worker(Honest):
    """Uses 1.5 s of processor time for each decision."""

    def assign(self, now, bins, carriers, memory):
        until = time.process_time() + 1.5
        while time.process_time() < until:
            pass
        return super().assign(now, bins, carriers, memory)


class Delegator(Worker):
    """Uses the processor time of a process that it forks, not its own."""

    def assign(self, now, bins, carriers, memory):
        child = os.fork()
        if child == 0:
            super().assign(now, bins, carriers, memory)
            os._exit(0)
        os.waitpid(child, 0)
        # The method of `Honest`: that of `Worker` would use its own time, too.
        return super(Worker, self).assign(now, bins, carriers, memory)


class DeafWorker(Worker):
    """A `Worker` that ignores the signal by which the system ends its processor time."""

    def __init__(self, layout):
        super().__init__(layout)
        signal.signal(signal.SIGXCPU, signal.SIG_IGN)


class LimitRaiser(Honest):
    """Raises the limit of its processor time to 1,000 s."""

    def assign(self, now, bins, carriers, memory):
        resource.setrlimit(resource.RLIMIT_CPU, (1000, 1000))


class Glutton(Honest):
    """Asks for 5 GB, more memory than a policy may have.

    It does not write to it, so the system needs none, and no machine runs out.
    """

    def assign(self, now, bins, carriers, memory):
        mmap.mmap(-1, 5 * 2**30, flags=mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS)


class Forker(Honest):
    """Lets a copy of itself answer too."""

    def assign(self, now, bins, carriers, memory):
        os.fork()
        return super().assign(now, bins, carriers, memory)


class Printer(Honest):
    """Writes answers to where other programs write theirs."""

    def assign(self, now, bins, carriers, memory):
        print("no orders", flush=True)
        os.write(1, b"\x00\x00\x00\x02no")
        return super().assign(now, bins, carriers, memory)


class NumberMaker(Honest):
    """Answers a number in place of orders."""

    def assign(self, now, bins, carriers, memory):
        return float("nan")


class OrderOfNumbers(Honest):
    """Gives an order whose names are numbers."""

    def assign(self, now, bins, carriers, memory):
        return [Assignment(float("nan"), float("nan"))]


class Unversioned(Honest):
    """Raises an error when it is asked for its version."""

    @property
    def version(self):
        raise Found("no version")


class Raiser(Honest):
    """Raises an error at each decision."""

    def assign(self, now, bins, carriers, memory):
        raise Found("nothing")


class Exiter(Honest):
    """Ends its process, with the exit code of a process that ends well."""

    def assign(self, now, bins, carriers, memory):
        os._exit(0)


class Crasher(Honest):
    """Reads at address 0, which ends its process by a signal."""

    def assign(self, now, bins, carriers, memory):
        ctypes.string_at(0)


class Inventor(Honest):
    """Sends a carrier that does not exist."""

    def assign(self, now, bins, carriers, memory):
        return [Assignment(report.name, "carrier_99") for report in bins]


class Forger(Honest):
    """Writes an answer of two letters, with their number before them, to all pipes that it has."""

    def assign(self, now, bins, carriers, memory):
        # The standard files are 0 to 2.
        for number in range(3, 64):
            try:
                os.write(number, b"\x00\x00\x00\x02no")
            except OSError:
                continue
        return []


class Flooder(Honest):
    """Says that its answer is larger than the memory of most machines."""

    def assign(self, now, bins, carriers, memory):
        for number in range(3, 64):
            try:
                os.write(number, b"\x7f\xff\xff\xff")
            except OSError:
                continue
        return []


def _write_answers(number):
    """Write that many empty answers to what the process knows as its pipe for answers."""
    from orchard.study.benchmark.exchange import Orders, framed

    # It is a local variable of one of the functions that called the policy.
    frame = sys._getframe()
    while "answers" not in frame.f_locals:
        frame = frame.f_back
    pipe = frame.f_locals["answers"].fileno()
    os.set_blocking(pipe, False)
    answer = framed(Orders([]))
    # A pipe takes 64 KB; it is full before the last.
    for _ in range(number):
        try:
            os.write(pipe, answer)
        except BlockingIOError:
            return


class Ahead(Honest):
    """Answers before it is asked, and hears no more questions."""

    def assign(self, now, bins, carriers, memory):
        _write_answers(100_000)
        time.sleep(3600.0)


class Deaf(Honest):
    """Answers once, and reads no more questions: the pipe of these is full in the end."""

    def assign(self, now, bins, carriers, memory):
        _write_answers(1)
        time.sleep(3600.0)


class Boaster(Honest):
    """Orders carriers to bins with names of a million letters."""

    def assign(self, now, bins, carriers, memory):
        return [Assignment("b" * 1_000_000, "c") for _ in range(10)]


class Learner(Honest):
    """Remembers in its module what happened in the harvest before."""

    harvests = 0

    def __init__(self, layout):
        super().__init__(layout)
        type(self).harvests += 1
        if self.harvests > 1:
            raise Found(self.harvests)
