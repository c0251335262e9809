"""The whole harvest of each scene in local mode: schedules begin from it, and must do the same.

A harvest is made once for each state of the program, in a process of its own, and kept in
`.harvests/`, where all workers read it. So it does not depend on what a test or a mutation has
changed in its own process.
"""

import fcntl
import hashlib
import subprocess
import sys
from collections import Counter
from collections.abc import Iterable, Mapping
from contextlib import suppress
from functools import cache, lru_cache
from pathlib import Path
from typing import Any

import msgspec

from chaos.simulated.scenes import SCENES
from orchard.contract.events import Event
from orchard.contract.messages import Written, pack, type_of, unpack
from orchard.field.scenario import Scenario
from orchard.folders import write_whole
from orchard.futures.moments import WatchedRun
from orchard.local import Local
from orchard.sim.snapshot import Snapshot

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / ".harvests"
EXPECTED = Path(__file__).parent / "expected.json"
# Ticks between two snapshots of a harvest, at which schedules can begin.
KEYFRAME_TICKS = 20
# Ticks after which a harvest is broken off whose length is not stored yet.
MOST_TICKS = 10_000
# A harvest that lasts for so many times its stored ticks is broken off.
LATER = 1.25
# What happens, beside events and messages.
HARVESTED = "harvested"
FAILED = "failed"
REPAIRED = "repaired"
# Events that are counted exactly: how often a bin is handled follows from rows and bins alone.
OF_BINS = ("coupled", "uncoupled", "bin full", "row picked", "unloaded")
# What must happen in a scene if it is stored of it, no matter how often.
OTHERS = ("picks from", "weed flattened", "charging", "charged", FAILED)
# Figures that two runs of a scenario may not have in common. They depend on the wall clock, or on
# how often an agent has joined, or only a run that is over has them.
OF_THIS_RUN = ("wall_seconds", "times_real_time", "asked_share", "schedule_sim_seconds")


class Counts(msgspec.Struct, forbid_unknown_fields=True):
    """What happens in a scene, as chaos/simulated/expected.json stores it.

    A harvest that is wrong in the same way in all modes is found by it.
    """

    # Of the whole harvest. A later change of the program may make it a little longer.
    ticks: int
    # Event of OF_BINS -> how often it happens.
    bins: dict[str, int]
    # What happens of OTHERS.
    others: list[str]

    def differences(self, expected: "Counts | None") -> list[str]:
        """Return a sentence for each count that is not the stored one."""
        if expected is None:
            return ["nothing is stored of it"]
        found = []
        for what, wanted in expected.bins.items():
            count = self.bins.get(what, 0)
            if count != wanted:
                found.append(f"{count} times {what!r}, not {wanted}")
        found += [f"never {what!r}" for what in expected.others if what not in self.others]
        if self.ticks > LATER * expected.ticks:
            found.append(f"{self.ticks} ticks, not {expected.ticks}")
        return found


class Harvest(msgspec.Struct):
    """A harvest in local mode, tick by tick."""

    made_by: str  # the digest of the program: see `program`
    ticks: int
    hashes: list[bytes]  # tick -> the hash
    figures: list[bytes]  # tick -> the digest of the figures
    steps: list[bytes]  # tick -> the digest of the events and messages of the step from it
    keyframes: dict[int, bytes]  # tick -> snapshot, packed
    moments: dict[str, list[int]]  # event, message, or state -> the ticks at which it happens
    differences: list[str]  # sentences on what is not as it is stored

    def last_keyframe(self, tick: int) -> int:
        """Return the tick of the last keyframe up to a tick."""
        return max(at for at in self.keyframes if at <= max(tick, 0))

    def snapshot(self, tick: int) -> Snapshot:
        """Return the state at the tick of a keyframe."""
        found: Snapshot = unpack(self.keyframes[tick], Snapshot)
        return found


# -- digests, with which runs of many processes are compared


def digest_of_figures(figures: Mapping[str, Any]) -> bytes:
    """Return the digest of the figures that each run of a scenario has at a tick, with their names
    in order.
    """
    return _digest(sorted((key, one) for key, one in figures.items() if key not in OF_THIS_RUN))


def digest_of_step(events: Iterable[Event], letters: Mapping[str, Written]) -> bytes:
    """Return the digest of what happened and was said in a step.

    In lockstep letters come in the order of arrival.
    """
    return _digest([list(events), sorted(letters.items())])


def _digest(data: Any) -> bytes:
    """Return a checksum of plain data."""
    return hashlib.blake2b(pack(data), digest_size=8).digest()


# -- making


class _Making:
    """A harvest that is made, tick by tick."""

    def __init__(self, scene: str, most: int) -> None:
        """`most`: ticks after which it is broken off."""
        self._run = WatchedRun(Local(Scenario(**SCENES[scene])).snapshot())
        self._most = most
        self._counts: Counter[str] = Counter()
        self._failed: set[str] = set()  # robots
        self.harvest = Harvest(program(), 0, [], [], [], {}, {}, [])

    def go_on(self) -> bool:
        """Record the state at a tick, and do the step from it. Return whether there was a step."""
        made = self.harvest
        run = self._run
        made.ticks = run.tick
        made.hashes.append(run.local.engine.digest)
        made.figures.append(digest_of_figures(run.figures.figures()))
        if run.tick % KEYFRAME_TICKS == 0:
            made.keyframes[run.tick] = pack(run.snapshot())
        # A run that goes on says that it would end by its duration.
        is_over = run.ended != "duration"
        if is_over:
            self._happens(HARVESTED)
        if is_over or run.tick >= self._most:
            return False
        self._step()
        return True

    def _step(self) -> None:
        """Do the next step, and record what happens in it."""
        run = self._run
        events = run.local.tick()
        run.figures.update(events)
        letters = run.local.post.written.get(self.harvest.ticks, {})
        self.harvest.steps.append(digest_of_step(events, letters))
        for event in events:
            self._happens(event.what)
        for written in letters.values():
            for _, body in written.sent:
                self._happens(type_of(body))
        self._look_at_failures()

    def _look_at_failures(self) -> None:
        """Record the robots that have just failed, or are just repaired: that is no event."""
        for name, action in self._run.local.answers.items():
            if action.state == FAILED and name not in self._failed:
                self._failed.add(name)
                self._happens(FAILED)
            elif action.state != FAILED and name in self._failed:
                self._failed.discard(name)
                self._happens(REPAIRED)

    def _happens(self, what: str) -> None:
        """Record that something happens at the present tick."""
        self._counts[what] += 1
        ticks = self.harvest.moments.setdefault(what, [])
        # Each tick once, however often it happens.
        if ticks[-1:] != [self.harvest.ticks]:
            ticks.append(self.harvest.ticks)

    @property
    def counts(self) -> Counts:
        """What is stored of it."""
        bins = {what: self._counts[what] for what in OF_BINS}
        others = [what for what in OTHERS if self._counts[what]]
        return Counts(self.harvest.ticks, bins, others)


def made(scene: str, expected: Counts | None) -> tuple[Harvest, Counts]:
    """Let local mode harvest a scene. Return the harvest, and what happened in it.

    `expected`: what is stored of it; None: it is made for the first time.
    """
    most = MOST_TICKS
    if expected is not None:
        most = int(LATER * expected.ticks) + 1
    making = _Making(scene, most)
    while making.go_on():
        pass
    return making.harvest, making.counts


# -- what is stored


def stored_counts() -> dict[str, Counts]:
    """Return what the repository holds of each scene."""
    found: dict[str, Counts] = msgspec.json.decode(EXPECTED.read_bytes(), type=dict[str, Counts])
    return found


def store_counts() -> dict[str, Counts]:
    """Count anew what happens in each scene, and store that in the repository."""
    counts = {scene: made(scene, None)[1] for scene in SCENES}
    EXPECTED.write_bytes(msgspec.json.format(msgspec.json.encode(counts)) + b"\n")
    return counts


@cache
def program() -> str:
    """Return a digest of all that a harvest follows from: the program, the scenes and what is
    stored of them.
    """
    here = Path(__file__).parent
    own = [here / name for name in ("harvest.py", "scenes.py", "talkers.py")]
    files = [*sorted((ROOT / "orchard").rglob("*.py")), *own, EXPECTED]
    digest = hashlib.blake2b(digest_size=16)
    for file in files:
        digest.update(str(file.relative_to(ROOT)).encode() + b"\0" + file.read_bytes() + b"\0")
    return digest.hexdigest()


@lru_cache(maxsize=len(SCENES))
def harvest_of(scene: str) -> Harvest:
    """Return the harvest of a scene.

    If this state of the program has none, it is made, by one process at a time.
    """
    FOLDER.mkdir(exist_ok=True)
    name = scene.replace(" ", "_").replace(",", "")
    file = FOLDER / f"{name}.msgpack"
    with (FOLDER / f"{name}.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        found = _read(file)
        if found is None:
            command = [sys.executable, "-m", "chaos.simulated.harvest", scene, str(file)]
            subprocess.run(command, cwd=ROOT, check=True)
            found = _read(file)
    if found is None:
        raise RuntimeError(f"{file}: it was made by another state of the program; start again")
    return found


def _read(file: Path) -> Harvest | None:
    """Return the harvest in a file; None if it is of another state of the program."""
    with suppress(OSError, ValueError):
        found: Harvest = unpack(file.read_bytes(), Harvest)
        if found.made_by == program():
            return found
    return None


def main(scene: str, file: str) -> None:
    """Make the harvest of a scene, and write it to a file."""
    expected = stored_counts().get(scene)
    harvest, counts = made(scene, expected)
    harvest.differences = counts.differences(expected)
    write_whole(Path(file), pack(harvest))


if __name__ == "__main__":
    main(*sys.argv[1:])
