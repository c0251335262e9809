"""The compiled kernels: torn or changed ones are never used, a full disk is no reason not to start,
and no tick waits for a compiler.

Kernels are the compiled inner loops of the simulator. They are kept in files (*.nbc), with
checksums, in a folder whose name is a hash of their sources (orchard/sim/kernels/cache.py).
"""

import logging
import os
import shutil
import subprocess
import sys
import time

import pytest
from command_line import PATH, ROOT, python
from local_runs import local_hash
from patience import PATIENCE

from orchard.field.scenario import Scenario
from orchard.sim.engine import Engine
from orchard.sim.kernels import cache
from orchard.sim.kernels.cache import KernelFiles

# What stands for the code of a kernel.
CODE = bytes(range(256)) * 40
TICKS = 20
PROGRAM = (
    "from local_runs import local_hash; from orchard.field.scenario import Scenario;"
    f" print(local_hash(Scenario(rows=3), {TICKS}))"
)
# Kernels that every start loads.
LOADED = (
    "move.quaternions",
    "holds.begin_holds",
    "move.overlaps",
)


def simulated(cache_folder) -> subprocess.CompletedProcess:
    """Simulate in a process with this folder of kernels."""
    return python("-c", PROGRAM, NUMBA_CACHE_DIR=str(cache_folder), PYTHONPATH=PATH)


@pytest.fixture
def kept(tmp_path):
    """Return a copy of the folder of compiled kernels."""
    local_hash(Scenario(rows=3), 1)
    folder = cache.kernels_folder()
    shutil.copytree(folder, tmp_path / folder.name)
    return tmp_path / folder.name


def tear(path):
    """Leave half of a file."""
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


def flip(path):
    """Change a bit of a file."""
    content = bytearray(path.read_bytes())
    content[-len(content) // 3] ^= 1
    path.write_bytes(content)


def test_kernels_are_there_once_some_of_these_sources_are_kept(tmp_path, monkeypatch):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    assert not cache.are_compiled()
    # Kernels of `laser.cast_all` are there after each run, in the folder of these sources.
    KernelFiles(tmp_path / "kernels-of-other-sources").keep("laser.cast_all-1.nbc", CODE)
    assert not cache.are_compiled()
    KernelFiles(cache.kernels_folder()).keep("laser.cast_all-1.nbc", CODE)
    assert cache.are_compiled()


def folder_of_kernels(above, digit: str):
    """Return the folder of the kernels of other sources, whose name is a hash of them."""
    return above / f"kernels-{digit * 16}"


def test_kernels_of_other_sources_go_after_a_day_without_use(tmp_path):
    """When a process keeps a kernel, it removes folders of other sources that nothing has used for
    a day. To load a kernel is to use its folder.
    """
    now = time.time()
    folders = {digit: folder_of_kernels(tmp_path, digit) for digit in "0123"}
    old, loaded, new, own = folders.values()
    for folder in folders.values():
        KernelFiles(folder).keep("scan.nbc", CODE)
    # A file that was left half written by a process that was killed.
    (old / ".laser.nbc.4711.new").write_bytes(CODE)
    for folder in (old, loaded, own):
        os.utime(folder, (now, now - cache.UNUSED_SECONDS - 60.0))
    assert KernelFiles(loaded).load("scan.nbc") == CODE
    KernelFiles(own).keep("laser.nbc", CODE)
    assert {folder for folder in folders.values() if folder.exists()} == {loaded, new, own}


def with_a_name_of_their_own(folder):
    folder.rename(folder.with_name("kernels-thesis"))


def without_the_mark(folder):
    (folder / cache.MARK).unlink()


def with_another_text_as_mark(folder):
    (folder / cache.MARK).write_text("My thesis is about compiled kernels.")


def with_a_chapter(folder):
    (folder / "chapter1.tex").write_text("Kernels are small programs.")


def with_a_folder(folder):
    (folder / "figures.nbc").mkdir()


def as_a_link(folder):
    folder.rename(folder.with_name("thesis"))
    folder.symlink_to("thesis")


@pytest.mark.parametrize(
    "changed",
    [
        with_a_name_of_their_own,
        without_the_mark,
        with_another_text_as_mark,
        with_a_chapter,
        with_a_folder,
        as_a_link,
    ],
)
def test_a_folder_that_may_be_the_users_stays_as_it_is(changed, tmp_path):
    folder = folder_of_kernels(tmp_path, "a")
    KernelFiles(folder).keep("scan.nbc", CODE)
    changed(folder)
    long_ago = time.time() - 100 * cache.UNUSED_SECONDS
    for path in tmp_path.iterdir():
        os.utime(path, (long_ago, long_ago))
    before = sorted(tmp_path.rglob("*"))
    own = folder_of_kernels(tmp_path, "b")
    KernelFiles(own).keep("laser.nbc", CODE)
    assert sorted({*tmp_path.rglob("*")} - {own, *own.iterdir()}) == before


def test_torn_kernels_are_compiled_anew_in_the_same_run(kept):
    for name, damage in zip(LOADED, (tear, flip, lambda path: path.write_bytes(b"")), strict=True):
        # More than one, if another test has compiled it for another processor.
        files = [*kept.glob(f"{name}-*.nbc")]
        assert files
        for file in files:
            damage(file)
    done = simulated(kept.parent)
    assert done.stdout.strip() == local_hash(Scenario(rows=3), TICKS), done.stderr
    assert done.stderr.splitlines() == [
        f"compiled kernels in {kept} are torn or changed; they are compiled anew, which takes up to"
        " a minute"
    ]
    load = KernelFiles(kept).load
    assert all(any(load(file.name) for file in kept.glob(f"{name}-*.nbc")) for name in LOADED), (
        "they are mended for the next start"
    )


def test_any_flipped_bit_or_cut_is_found(tmp_path, caplog):
    files = KernelFiles(tmp_path)
    files.keep("a.nbc", CODE)
    assert files.load("a.nbc") == CODE
    whole = (tmp_path / "a.nbc").read_bytes()
    # At every 97th byte: some hundred places.
    for at in range(0, len(whole), 97):
        changed = whole[:at] + bytes([whole[at] ^ 1 << at % 8]) + whole[at + 1 :]
        for damaged in (changed, whole[:at], whole + whole[:at] if at else b""):
            (tmp_path / "a.nbc").write_bytes(damaged)
            assert files.load("a.nbc") is None
    assert len(caplog.records) == 1


def test_the_code_of_another_kernel_is_not_used(tmp_path, caplog):
    files = KernelFiles(tmp_path)
    for name, code in (("a.nbc", CODE), ("b.nbc", CODE[::-1])):
        files.keep(name, code)
    shutil.copy(tmp_path / "a.nbc", tmp_path / "b.nbc")
    assert files.load("a.nbc") == CODE
    assert files.load("b.nbc") is None
    assert "are torn or changed" in caplog.text


def test_a_full_disk_keeps_no_kernel_and_says_so_in_one_line(tmp_path, caplog, monkeypatch):
    def full(file):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    files = KernelFiles(tmp_path / "kernels")
    for name in ("a.nbc", "b.nbc"):
        files.keep(name, CODE)
        assert files.load(name) is None
    assert [record.getMessage() for record in caplog.records] == [
        f"compiled kernels cannot be kept in {tmp_path}/kernels: No space left on device; the next"
        " start compiles them again"
    ]
    assert list((tmp_path / "kernels").iterdir()) == []


def test_a_folder_that_cannot_be_made_is_no_reason_not_to_start(tmp_path, caplog):
    (tmp_path / "file").write_text("in its place")
    files = KernelFiles(tmp_path / "file")
    files.keep("a.nbc", CODE)
    assert files.load("a.nbc") is None
    assert [record.levelno for record in caplog.records] == [logging.WARNING] * 2


def test_a_reader_beside_a_writer_never_sees_a_part(tmp_path, caplog):
    """One process reads a kernel while another one writes it."""
    program = (
        "import sys; from pathlib import Path; from orchard.sim.kernels.cache import KernelFiles\n"
    )
    program += (
        "for i in range(100): KernelFiles(Path(sys.argv[1])).keep('a.nbc', bytes([i % 2]) *"
        " 200_000)"
    )
    files = KernelFiles(tmp_path)
    codes = (None, bytes(200_000), bytes([1]) * 200_000)
    writers = [
        subprocess.Popen([sys.executable, "-c", program, str(tmp_path)], cwd=ROOT) for _ in range(2)
    ]
    deadline = time.monotonic() + PATIENCE
    try:
        while None in [writer.poll() for writer in writers]:
            assert files.load("a.nbc") in codes
            assert time.monotonic() < deadline, "the writers do not come to an end"
    finally:
        for writer in writers:
            writer.kill()
            writer.wait()
    assert [writer.returncode for writer in writers] == [0, 0]
    assert caplog.records == []
    assert {path.name for path in tmp_path.iterdir()} == {"a.nbc", cache.MARK}


@pytest.mark.soak
def test_two_starts_without_kernels_both_reach_the_hash(tmp_path):
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path), "PYTHONPATH": PATH}
    start = [sys.executable, "-c", PROGRAM]
    both = [
        subprocess.Popen(
            start, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        )
        for _ in range(2)
    ]
    assert [process.communicate(timeout=PATIENCE) for process in both] == [
        (local_hash(Scenario(rows=3), TICKS) + "\n", "")
    ] * 2


@pytest.mark.soak
def test_all_kernels_torn_are_compiled_anew(kept):
    for file in kept.iterdir():
        tear(file)
    assert simulated(kept.parent).stdout.strip() == local_hash(Scenario(rows=3), TICKS)
    assert simulated(kept.parent).stderr == ""


# A program that prints the kernels which a whole harvest has compiled, or compiled for other types,
# after the rehearsal: the run that compiles them all before the first tick.
HARVEST = """
import sys
from numba.core.dispatcher import Dispatcher
from orchard.field.scenario import Scenario
from orchard.sim.engine import Engine
from orchard.local import Local

def known():
    modules = [sys.modules[name] for name in sorted(sys.modules) if name.startswith("orchard.")]
    kernels = [thing for module in modules for thing in vars(module).values()]
    compiled = [kernel for kernel in kernels if isinstance(kernel, Dispatcher)]
    return {str(kernel): len(kernel.signatures) for kernel in compiled}

scenario = Scenario(rows=3, pickers=2, laser={"noise": 0.01})
Engine.begin(scenario).rehearse()
rehearsed, run, seen = known(), Local(scenario), set()
while not run.engine.over:
    seen |= {event.what for event in run.tick()}
assert {"coupled", "row picked", "unloaded", "weed flattened"} <= seen, seen
print(*[name for name, signatures in known().items() if signatures != rehearsed[name]])
"""


def test_a_rehearsed_harvest_needs_no_further_kernel():
    done = python("-c", HARVEST)
    assert done.stdout.split() == []
    assert done.stderr == ""


def test_a_rehearsal_changes_nothing():
    engine = Engine.begin(Scenario())
    other = Engine.begin(Scenario())
    engine.rehearse()
    for each in (engine, other):
        each.observe()
        each.advance({}, {})
    assert engine.hash == other.hash
    assert engine.figures_as_data() == other.figures_as_data()
