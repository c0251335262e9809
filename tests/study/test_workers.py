"""Workers do all work once, whatever dies, on two machines too; none outlives its parent.

Workers are processes that do the runs of a study: on this machine, or those of a scheduler of Dask.
`workers.do(work, items, goes_on)` gives (item, result) of each item, while `goes_on()` is true. The
functions of tests/study/work.py are the work.
"""

import json
import os
import signal
import subprocess
import sys
import threading
import time
from concurrent.futures import BrokenExecutor, Future, wait
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import psutil
import pytest
from command_line import ROOT, orchard
from machines import machines, needs_machines, within
from patience import PATIENCE
from work import (
    blocked_signals,
    complaining,
    deadly,
    double,
    faulty,
    garbage_threshold,
    loud,
    slow,
)

from orchard.contract.printed import MOST_LINES
from orchard.field.scenario import Scenario
from orchard.memory import YOUNG
from orchard.study import workers as module
from orchard.study.options import StudyOptions
from orchard.study.study import study
from orchard.study.workers import (
    MOST_ERRORS,
    WorkerDied,
    Workers,
    WorkersError,
    processes,
    scheduled,
)

HERE = Path(__file__).parent
# A file that exists: `double` kills its worker at the number 3, unless the file that it is given
# exists.
NOBODY_DIES = Path(__file__)
NUMBERS = list(range(12))


def always() -> bool:
    return True


def test_a_worker_that_is_killed_loses_and_doubles_nothing(tmp_path):
    """`double` kills its worker at 3, and makes the file `died` first."""
    items = [(number, tmp_path / "died") for number in NUMBERS]
    with processes(2) as workers:
        done = list(workers.do(double, items, always))
    assert (tmp_path / "died").exists()
    assert sorted(result for _, result in done) == [2 * number for number in NUMBERS]
    assert all(result == 2 * item[0] for item, result in done)


def test_a_worker_that_dies_between_rounds_is_replaced():
    """The executor knows of the death before the next round, and takes no more work."""
    with processes(1) as workers:
        list(workers.do(double, [(1, NOBODY_DIES)], always))
        executor: Any = workers.executor
        (worker,) = executor._processes.values()
        noticed = executor._executor_manager_thread
        worker.kill()
        noticed.join(PATIENCE)
        done = workers.do(double, [(number, NOBODY_DIES) for number in NUMBERS], always)
        assert sorted(result for _, result in done) == [2 * number for number in NUMBERS]


def test_workers_seldom_look_for_garbage():
    """Else a fifth of their time would go to it."""
    with processes(1) as workers:
        assert [result for _, result in workers.do(garbage_threshold, [1], always)] == [YOUNG]


def test_ctrl_c_at_the_terminal_is_the_parents():
    """Workers block SIGINT, and the process that has started them does not."""
    with processes(1) as workers:
        assert [signals for _, signals in workers.do(blocked_signals, [1], always)] == [
            {signal.SIGINT}
        ]
    assert signal.SIGINT not in blocked_signals(None)


def test_work_that_kills_each_worker_ends_the_study_with_words():
    with processes(1) as workers, pytest.raises(WorkersError, match="3 times a worker died"):
        list(workers.do(deadly, [1], always))


class Pool:
    """Workers of which one dies if the number 3 is with them; then all their work is lost."""

    def __init__(self):
        self.numbers: dict[Future, int] = {}

    def submit(self, work, number) -> Future:
        future = Future()
        self.numbers[future] = number
        return future

    def shutdown(self): ...

    def wait(self, futures, *rest):
        """Do the work of these futures, or die."""
        dies = any(self.numbers[future] == 3 for future in futures)
        for future in futures:
            if dies:
                future.set_exception(BrokenExecutor())
            else:
                future.set_result(self.numbers[future])
        return wait(futures)


def test_work_that_kills_each_worker_is_named(monkeypatch):
    """No other work is taken for it, though it was with the workers each time that one died."""
    pools = []

    def start() -> Pool:
        pools.append(Pool())
        monkeypatch.setattr(module, "wait", pools[-1].wait)
        return pools[-1]

    done = Workers(start, count=2).do(double, [1, 2, 3], always)
    assert [next(done), next(done)] == [(1, 1), (2, 2)]
    with pytest.raises(WorkerDied) as raised:
        next(done)
    assert raised.value.item == 3


def test_an_error_of_the_work_comes_back():
    with processes(1) as workers, pytest.raises(LookupError, match="no 1"):
        list(workers.do(faulty, [1], always))


def test_of_what_own_classes_print_some_harmless_lines_are_shown(capfd):
    with processes(1) as workers:
        list(workers.do(loud, ["\x1b[2Jown"], always))
    out, said = capfd.readouterr()
    assert out == ""
    assert said.count("printed: ?[2Jown") == MOST_LINES
    assert "\x1b" not in said


def test_the_first_errors_of_own_classes_are_shown_once(capfd):
    """They name their own place, so none is added."""
    with processes(1) as workers:
        list(workers.do(complaining, ["policy mine.A"], always))
    said = capfd.readouterr().err
    assert said.splitlines() == [f"policy mine.A, tick {number}" for number in range(MOST_ERRORS)]


def is_gone(pid: int) -> bool:
    """Whether a process has ended."""
    return not psutil.pid_exists(pid) or psutil.Process(pid).status() == psutil.STATUS_ZOMBIE


def eventually(holds) -> None:
    """Wait until a condition holds."""
    end = time.monotonic() + PATIENCE
    while not holds():
        assert time.monotonic() < end, "it never came"
        time.sleep(0.05)


def test_stop_does_not_wait_for_long_work(tmp_path):
    """`slow` writes the number of its process into a file, and then works for ever."""
    told = tmp_path / "pid"
    with processes(1) as workers:
        assert (
            list(workers.do(slow, [told], lambda: not told.exists() or not told.read_text())) == []
        )
    eventually(lambda: is_gone(int(told.read_text())))


def test_a_worker_that_is_killed_at_the_stop_is_no_failure(tmp_path, monkeypatch):
    """A person who stops a study may end its workers too. The thread of Python's pool then fails,
    if work is left that was cancelled.
    """
    failures = []
    monkeypatch.setattr(threading, "excepthook", failures.append)
    told = [tmp_path / str(number) for number in NUMBERS]
    with processes(1) as workers:
        executor: Any = workers.executor
        done = workers.do(slow, told, lambda: not told[0].exists() or not told[0].read_text())
        assert list(done) == []
        ended = executor._executor_manager_thread
        os.kill(int(told[0].read_text()), signal.SIGTERM)
        ended.join(PATIENCE)
    assert failures == []


def test_workers_end_with_a_parent_that_is_killed(tmp_path):
    told = tmp_path / "pid"
    script = (
        "import sys; from pathlib import Path; from work import slow; from orchard.study.workers"
        " import processes\nif __name__ == '__main__':\n    with processes(1) as workers:"
        " list(workers.do(slow, [Path(sys.argv[1])], lambda: True))\n"
    )
    (tmp_path / "parent.py").write_text(script)
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([str(HERE.parent.parent), str(HERE)])}
    parent = subprocess.Popen(
        [sys.executable, str(tmp_path / "parent.py"), str(told)], env=environment
    )
    try:
        eventually(lambda: told.exists() and bool(told.read_text()))
    finally:
        parent.kill()
        parent.wait(PATIENCE)
    eventually(lambda: is_gone(int(told.read_text())))


def dask_process(module: str, *arguments: object, before: tuple[str, ...] = ()) -> subprocess.Popen:
    """Start one of Dask's programs. `before`: words that start it on another machine."""
    environment = os.environ | {
        "PYTHONPATH": os.pathsep.join(
            [str(HERE.parent.parent), str(HERE), str(HERE.parent / "support")]
        )
    }
    command = [*before, sys.executable, "-m", f"distributed.cli.{module}", *map(str, arguments)]
    return subprocess.Popen(command, env=environment, stderr=subprocess.DEVNULL)


def test_a_scheduler_gives_the_same_table_after_a_death(tmp_path, monkeypatch):
    """One of its two workers dies at 3 of NUMBERS. Then a study there gives the table that it gives
    here. At last workers whose clocks seem to be wrong are refused.
    """
    file = tmp_path / "scheduler.json"
    scenario = Scenario(rows=3, picking_speed=0.5, picking={"spread": {"distribution": "gamma"}})
    varied = {"carriers": [1, 2]}
    common = {"model": "fast", "budget_seconds": 10_000.0, "within": 0.2}
    with ExitStack() as stack:

        def started(*words: object) -> None:
            process = dask_process(*words)
            stack.callback(process.wait, PATIENCE)
            stack.callback(process.kill)

        started(
            "dask_scheduler",
            "--host",
            "127.0.0.1",
            "--port",
            0,
            "--scheduler-file",
            file,
            "--no-dashboard",
            "--no-show",
        )
        for _ in range(2):
            started(
                "dask_worker",
                "--scheduler-file",
                file,
                "--no-nanny",
                "--nthreads",
                1,
                "--no-dashboard",
                "--local-directory",
                tmp_path,
            )
        address = address_in(file)
        eventually(lambda: workers_at(address) == 2)
        with scheduled(address) as workers:
            done = list(
                workers.do(double, [(number, tmp_path / "died") for number in NUMBERS], always)
            )
        assert sorted(result for _, result in done) == [2 * number for number in NUMBERS]
        assert workers_at(address) == 1, "the other one died"
        there = study(
            scenario, varied, StudyOptions(**common, scheduler=address, store=tmp_path / "there.db")
        )
        # Clocks may be less than this apart: so no two clocks agree.
        monkeypatch.setattr("orchard.study.workers.APART", -600.0)
        clocks = (
            r"clocks of workers differ from that of this machine: tcp://\S+ by [+-]0 s; set them"
        )
        with pytest.raises(WorkersError, match=clocks), scheduled(address):
            pass
    here = study(scenario, varied, StudyOptions(**common, workers=1, store=tmp_path / "here.db"))
    assert there.table == here.table


def address_in(file: Path) -> str:
    """Return the address of the scheduler, once it has written its file."""
    eventually(lambda: file.exists() and file.read_text().endswith("}"))
    return json.loads(file.read_text())["address"]


def workers_at(address: str) -> int:
    """Return how many workers a scheduler has."""
    try:
        with scheduled(address) as workers:
            return workers.count
    except WorkersError:
        return 0


def test_a_scheduler_that_is_not_there_is_told(monkeypatch):
    monkeypatch.setattr("orchard.study.workers.CONNECTING", 1.0)
    silent = r"tcp://127\.0\.0\.1:1: no scheduler of dask\.distributed answers"
    with pytest.raises(WorkersError, match=silent), scheduled("tcp://127.0.0.1:1"):
        pass


QUESTION = ("--vary", "carriers=1,2", "--model", "fast", "--budget", "2h", "--within", "10%")
SCENARIO = "rows: 3\npicking_speed: 0.5\npicking: {spread: {distribution: gamma}}\n"
ADDRESS = "tcp://192.168.1.10:8786"


@needs_machines
def test_two_machines_give_the_same_table_as_one(tmp_path):
    (tmp_path / "my.yaml").write_text(SCENARIO)
    orchard(
        "study",
        tmp_path / "my.yaml",
        *QUESTION,
        "--out",
        tmp_path / "here.db",
        "--summary",
        tmp_path / "here.json",
    )
    with machines("study") as (host, guest), ExitStack() as stack:
        for machine, module, *arguments in (
            (
                host,
                "dask_scheduler",
                "--host",
                "192.168.1.10",
                "--port",
                8786,
                "--no-dashboard",
                "--no-show",
            ),
            (
                host,
                "dask_worker",
                ADDRESS,
                "--no-nanny",
                "--nthreads",
                1,
                "--no-dashboard",
                "--local-directory",
                tmp_path / "a",
            ),
            (
                guest,
                "dask_worker",
                ADDRESS,
                "--no-nanny",
                "--nthreads",
                1,
                "--no-dashboard",
                "--local-directory",
                tmp_path / "b",
            ),
        ):
            process = dask_process(module, *arguments, before=tuple(within(machine)))
            stack.callback(process.wait, PATIENCE)
            stack.callback(process.kill)
        wait_for_workers(host)
        options = [
            "--out",
            tmp_path / "there.db",
            "--summary",
            tmp_path / "there.json",
            "--scheduler",
            ADDRESS,
        ]
        command = [
            *within(host),
            sys.executable,
            "run.py",
            "study",
            tmp_path / "my.yaml",
            *QUESTION,
            *options,
        ]
        there = subprocess.run(
            [*map(str, command)], cwd=ROOT, capture_output=True, text=True, timeout=PATIENCE
        )
        assert there.returncode == 0, there.stderr
    tables = [
        json.loads((tmp_path / name).read_text())["table"] for name in ("here.json", "there.json")
    ]
    assert tables[0] == tables[1]


def wait_for_workers(machine: str) -> None:
    script = (
        "import sys; from distributed import Client\n"
        f"with Client(sys.argv[1], timeout={PATIENCE}) as client:\n"
        f"    client.wait_for_workers(2, timeout={PATIENCE})\n"
    )
    subprocess.run(
        [*within(machine), sys.executable, "-c", script, ADDRESS],
        check=True,
        timeout=PATIENCE,
        env=os.environ,
    )
