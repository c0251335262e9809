"""What all tests share: settings of pytest and hypothesis, and fixtures.

Helpers stand in tests/support, which is put on Python's path here: tests import them by name, as
`from stage import Stage`. Whatever test runs an orchard in this process, its invariants
(`orchard/sim/invariants.py`) must hold at every tick.
"""

import gc
import os
import sys
from contextlib import ExitStack
from pathlib import Path

import pytest
from hypothesis import settings

from orchard.field.layout import lay_out
from orchard.field.scenario import Scenario
from orchard.launch.supervisor import QUICK_START
from orchard.memory import collect_seldom
from orchard.report import metrics
from orchard.sim.engine import Engine
from orchard.sim.kernels.cache import are_compiled

sys.path.insert(0, str(Path(__file__).parent / "support"))
# The tests start hundreds of processes, which inherit this. What the environment has already stays.
os.environ |= QUICK_START | os.environ

import calling_agents
from fleet import Fleet
from local_runs import SMALL, TICKS, local_hash
from page_server import WINDOW, chromium_with, served
from recorded_messages import recorded
from recordings import SECONDS, frames, recording_of
from secured_run import make_roles
from simulated_fleet import SimulatedFleet
from stage import ONE_WAY

# Neither has a time limit: it would depend on what else the machine does. `make test` draws the
# same examples each time, so that what it says of a change is not luck. `make soak` searches.
settings.register_profile("repeatable", deadline=None, derandomize=True)
settings.register_profile("search", deadline=None)
settings.load_profile("repeatable")


def pytest_configure(config: pytest.Config) -> None:
    """Compile the kernels once, before several workers and hundreds of processes do it."""
    collect_seldom()
    # The workers of pytest-xdist have `workerinput`; the process that starts them has not.
    is_worker = hasattr(config, "workerinput")
    if not is_worker and not are_compiled():
        Engine.begin(Scenario(rows=3, laser={"noise": 0.01})).rehearse()


# Last: only the tests that `-m` and `-k` have left are ordered.
@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Let one worker begin with the tests of the page, and the next one with those that wait for
    processes: the other workers use the processor meanwhile.

    pytest-xdist gives each worker an equal share of the list, in order. A worker that is done takes
    tests from the end of another one's share.
    """
    of_page = list[pytest.Item]()
    waiting = list[pytest.Item]()
    others = list[pytest.Item]()
    for item in items:
        fixtures = getattr(item, "fixturenames", ())
        waits = "battered" in fixtures or item.get_closest_marker("processes")
        if "chromium" in fixtures:
            of_page.append(item)
        elif waits:
            waiting.append(item)
        else:
            others.append(item)
    workers = getattr(config, "workerinput", {"workercount": 1})["workercount"]
    share = len(items) // workers
    # The first share is filled up with other tests, so that the next one begins with `waiting`.
    filling = max(0, share - len(of_page))
    items[:] = of_page + others[:filling] + waiting + others[filling:]


def pytest_collection_finish() -> None:
    """Let the collector never visit again what is imported by now."""
    gc.freeze()


@pytest.fixture(scope="session", autouse=True)
def data_of_the_tests(tmp_path_factory):
    """Keep what the user of this machine has recorded or studied out of all tests."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("ORCHARD_RUNS", str(tmp_path_factory.mktemp("runs")))
        yield


@pytest.fixture(autouse=True)
def invariants_hold(monkeypatch):
    """Fail a test at the first tick after which an invariant is broken.

    This holds for all engines in this process.
    """
    account = Engine.account

    def account_and_look(self):
        account(self)
        assert self._invariants.violations == []

    monkeypatch.setattr(Engine, "account", account_and_look)


@pytest.fixture
def soon_jammed(monkeypatch):
    """Let a run count as jammed after two minutes without progress, not ten."""
    monkeypatch.setattr(metrics, "JAM_SECONDS", 120.0)


@pytest.fixture
def fleet(tmp_path, request):
    """Start processes of a run, and leave none behind.

    They are simulated, unless the test is marked as one about processes.
    """
    is_about_processes = request.node.get_closest_marker("processes")
    fleet_type = Fleet if is_about_processes else SimulatedFleet
    with ExitStack() as stack:
        yield fleet_type(tmp_path, stack)


@pytest.fixture(scope="session")
def undisturbed():
    """Return the hash of the small orchard's callers when no fault happens to them."""
    return local_hash(SMALL, TICKS, calling_agents.cast(lay_out(SMALL)))


@pytest.fixture(scope="session")
def other():
    """Return the messages of 40 ticks of another run of the small scenario."""
    return recorded(SMALL, "other", 40)


@pytest.fixture(scope="session")
def folder(tmp_path_factory) -> Path:
    """Make the roles of the small scenario, for this machine and another one."""
    return make_roles(tmp_path_factory.mktemp("secure") / "roles", "192.168.1.10")


@pytest.fixture(scope="session")
def stranger(tmp_path_factory) -> Path:
    """Make roles by another authority."""
    return make_roles(tmp_path_factory.mktemp("stranger") / "roles")


@pytest.fixture(scope="session")
def server(tmp_path_factory):
    """Serve the page. Give its address, and the folder of its runs."""
    runs = tmp_path_factory.mktemp("runs")
    with served(runs) as address:
        yield address, runs


@pytest.fixture(scope="session")
def downloads(tmp_path_factory):
    """Make the folder into which the browser downloads."""
    return tmp_path_factory.mktemp("downloads")


@pytest.fixture(scope="session")
def chromium(tmp_path_factory, downloads):
    """Open a browser without Rerun's viewer, which takes the processor for long.

    `tests/view/test_pixels.py` looks at pictures.
    """
    with chromium_with(tmp_path_factory.mktemp("profile"), downloads) as browser:
        # The viewer is a file of WebAssembly.
        browser.driver.execute_cdp_cmd("Network.enable", {})
        browser.driver.execute_cdp_cmd("Network.setBlockedURLs", {"urls": ["*.wasm"]})
        yield browser


@pytest.fixture
def browser(chromium, server):
    """Open the page with the default orchard.

    One page serves many tests: to open it takes longer than most of them.
    """
    chromium.driver.set_window_size(*WINDOW)
    chromium.begin(server[0])
    return chromium


@pytest.fixture(scope="session")
def layout():
    """Return the orchard whose recording tests share: 3 rows, one-way roads."""
    return lay_out(Scenario(rows=3, dispatch="nearest", **ONE_WAY))


@pytest.fixture(scope="session")
def harvested(layout):
    """Return the first frames of a harvest of `layout`, a frame for each tick."""
    return list(frames(layout, SECONDS))


@pytest.fixture(scope="session")
def recording(layout, harvested, tmp_path_factory):
    """Return the file in which the frames of `harvested` are recorded."""
    return recording_of(tmp_path_factory.mktemp("picture") / "run.rrd", layout, harvested)
