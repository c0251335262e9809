"""The page in a browser, for tests: a server of its own, and headless Chromium."""

import os
import shutil
import signal
import subprocess
import sys
import time
import urllib.request
from contextlib import contextmanager
from pathlib import Path

import pytest
from patience import PATIENCE

from orchard.launch.supervisor import free_port

ROOT = Path(__file__).parents[2]
PROGRAMS = [shutil.which("chromium"), shutil.which("chromedriver")]
WINDOW = (1500, 1000)  # pixels

# Where nothing is skipped.
ON_CI = os.environ.get("CI") == "true"


def skip_without_packages() -> None:
    """Skip the file that calls this if packages of the page are missing."""
    for package in () if ON_CI else ("nicegui", "selenium", "axe_core_python"):
        pytest.importorskip(
            package, reason=f"{package} is missing: pip install 'orchard-sim[app,dev]'"
        )


def page(*arguments: object) -> list[str]:
    return [sys.executable, "-m", "orchard", "app", "--quiet", *map(str, arguments)]


def wait_for(process: subprocess.Popen, address: str, seconds: float = PATIENCE) -> None:
    deadline = time.monotonic() + seconds
    while time.monotonic() < deadline and process.poll() is None:
        try:
            # On a busy machine the first page takes longer than any short limit.
            urllib.request.urlopen(address, timeout=seconds).close()
            return
        except OSError:
            time.sleep(0.1)
    raise AssertionError(f"{address} does not answer")


@contextmanager
def served(runs: Path):
    port = free_port()
    # By this variable NiceGUI would take the server for a test of its own.
    plain = {name: value for name, value in os.environ.items() if name != "PYTEST_CURRENT_TEST"}
    process = subprocess.Popen(
        page("--port", port, "--runs", runs), cwd=ROOT, stdout=subprocess.DEVNULL, env=plain
    )
    address = f"http://127.0.0.1:{port}"
    try:
        wait_for(process, address)
        yield address
    finally:
        process.send_signal(signal.SIGINT)
        assert process.wait(PATIENCE) == 0


@contextmanager
def chromium_with(folder: Path, downloads: Path, *flags: str):
    """Open a browser with its profile in a folder. `flags`: more of its options."""
    if None in PROGRAMS:
        (pytest.fail if ON_CI else pytest.skip)(
            "chromium and chromedriver are missing (.ci/apt-packages.txt)"
        )
    from browser import Browser, open_browser

    driver = open_browser(*PROGRAMS, str(folder), str(downloads), *flags)
    try:
        yield Browser(driver)
    finally:
        driver.quit()
