"""Compiling the machine of the event model, which takes 40 s: once, with a message, and not for
harvests that do without it.

Compiled code is kept on the disk; a process that finds it there compiles nothing.
"""

from typing import Any

import pytest

from orchard.discrete.harvest import get_ready
from orchard.event_model.kernel import entry
from orchard.field.layout import lay_out
from orchard.field.scenario import Scenario
from orchard.report.bounds import schedule_seconds
from orchard.sim.kernels import cache
from orchard.sim.kernels.cache import KernelFiles

QUIET = {
    "people": {"workers": 0, "visitors": 0},
    "animals": {"dogs": 0, "cats": 0},
}


@pytest.fixture
def compiled(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """Forget that the machine is compiled in this process. Return what is compiled from now on."""
    signatures: list[Any] = []
    entry.get_ready.cache_clear()
    monkeypatch.setattr(entry._run, "compile", signatures.append)
    return signatures


@pytest.mark.parametrize("is_kept", [False, True])
def test_compiling_is_said_unless_the_code_is_kept(
    is_kept: bool,
    compiled: list[Any],
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    monkeypatch.setattr(entry, "is_kept", lambda kernel, signature: is_kept)
    get_ready([Scenario(), Scenario(**QUIET)])
    # Also code that is kept is loaded by `compile`, once for both scenarios.
    assert compiled == [entry.SIGNATURE]
    assert caplog.messages == ([] if is_kept else [entry.COMPILING])


def test_nothing_is_compiled_for_harvests_of_the_simulator(compiled: list[Any]) -> None:
    get_ready([Scenario(sensors={"odometry": {"distance": 0.02}})])
    assert compiled == []


def test_a_summary_waits_for_no_compiler(
    compiled: list[Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The machine runs as plain Python where it is not compiled, with the same result."""
    layout = lay_out(Scenario(rows=3, pickers=2, carriers=1))
    seconds = schedule_seconds(layout)
    monkeypatch.setattr(entry, "is_kept", lambda kernel, signature: False)
    compiled.clear()
    entry.get_ready.cache_clear()
    assert schedule_seconds(layout) == seconds
    assert compiled == []


def test_the_machine_is_no_kernel_of_the_simulator(
    tmp_path: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its code is kept beside the simulator's kernels, and does not count as one of them."""
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    folder = cache.kernels_folder()
    assert folder is not None
    KernelFiles(folder).keep("entry._run-1.nbc", b"code")
    assert not cache.are_compiled()
