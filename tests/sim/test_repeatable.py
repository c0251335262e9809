"""The same seed gives the same run, to the last bit: repeated, from any agent's memory, on any
processor; another run has another hash.
"""

import copy

import numpy as np
import pytest
from command_line import PATH, python
from local_runs import HARVEST_TICKS, harvest_hash, local_hash, played, start_afresh

from orchard.field.layout import lay_out
from orchard.field.scenario import LaserSettings, Scenario
from orchard.local import Local
from orchard.sim.engine import next_digest
from orchard.sim.scan import Scanner
from orchard.sim.world import World


def test_the_same_seed_gives_the_same_run():
    hashes = [local_hash(Scenario(rows=3, seed=seed), 300) for seed in (1, 1, 2, 3, 4, 5)]
    assert hashes[0] == hashes[1]
    assert len(set(hashes)) == 5


def test_laser_noise_is_repeatable_and_part_of_the_run():
    noisy = Scenario(rows=3, laser=LaserSettings(noise=0.02))
    assert local_hash(noisy, 200) == local_hash(noisy, 200) != local_hash(Scenario(rows=3), 200)


def test_a_velocity_that_is_off_by_a_trillionth_changes_the_hash():
    class Touched:
        """A picker with another velocity at one tick.

        It promises nothing (`Hold`), so it is asked at each tick.
        """

        def __init__(self, agent, more) -> None:
            self.agent = agent
            self.Memory = agent.Memory
            self.more = more

        def tick(self, seen, mail, memory):
            action = self.agent.tick(seen, mail, memory)
            if seen.tick == 40:
                action.twist = action.twist._replace(x=action.twist.x + self.more)
            return action

    def hash_with(more):
        local = Local(Scenario(rows=3))
        return played(local, 60, picker_01=Touched(local.agents["picker_01"], more)).engine.hash

    assert hash_with(0.0) == local_hash(Scenario(rows=3), 60)
    assert hash_with(-1e-12) != hash_with(0.0)


# What can be asked of an engine, and gives the same whether steps are accounted for at once
# (`advance`) or only when something is asked (`step`, which lets physics send first).
ASKED = {
    "the hash": lambda engine: engine.hash,
    "the snapshot's digest": lambda engine: engine.digest,
    "the snapshot's figures": lambda engine: engine.figures_as_data(),
    "the summary": lambda engine: engine.states.figures(),
    "violations": lambda engine: engine.violations(),
}


@pytest.mark.parametrize("asked", ASKED)
def test_a_step_that_is_accounted_for_later_counts_the_same(asked):
    """Between the ticks 30 and 60 a robot is stopped, which must count at the right ticks."""
    at_once = Local(Scenario(rows=3))
    later = Local(Scenario(rows=3))
    later.engine.advance = later.engine.step
    for tick in range(200):
        for local in (at_once, later):
            local.tick()
            if tick == 30:
                assert "picker_01" in local.engine.stop(["picker_01"]), (
                    "it drives, and stands from now on"
                )
            if tick == 60:
                local.engine.reset()
    assert ASKED[asked](later.engine) == ASKED[asked](at_once.engine)


def test_all_agents_started_afresh_at_every_tick_changes_nothing():
    local = Local(Scenario(rows=3))
    for tick in range(HARVEST_TICKS):
        if tick:
            start_afresh(local)
        local.tick()
    assert local.engine.hash == harvest_hash()


# Environment variables under which numpy, the C library and numba use only what an older processor
# has.
ANY_PROCESSOR = {
    # Numpy without AVX-512.
    "NPY_DISABLE_CPU_FEATURES": "X86_V4",
    "OPENBLAS_CORETYPE": "Nehalem",  # another BLAS
    "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-FMA,-FMA4,-AVX2,-AVX2_Usable,-FMA_Usable",
    # Kernels that are compiled for any of them.
    "NUMBA_CPU_NAME": "x86-64",
    "NUMBA_CPU_FEATURES": "",
}


def test_the_hash_is_the_same_on_another_processor(request):
    """Kernels for the other processor are kept for the next tests, as those for this one are."""
    program = "from local_runs import harvest_hash; print(harvest_hash())"
    kernels = str(request.config.cache.mkdir("kernels"))
    assert (
        python(
            "-c", program, **ANY_PROCESSOR, PYTHONPATH=PATH, NUMBA_CACHE_DIR=kernels
        ).stdout.strip()
        == harvest_hash()
    )


NONE_SEEN = np.zeros(0, dtype=np.float32)


def hash_of(world: World, ranges: np.ndarray, mail: dict[str, bytes]) -> str:
    return next_digest(bytes(32), world, ranges, mail).hex()


def _nudge(array: np.ndarray) -> None:
    """Change the first value of an array."""
    flat = array.reshape(-1)
    if array.dtype == bool:
        flat[0] = ~flat[0]
    elif array.dtype.kind == "i":
        flat[0] += 1
    else:
        flat[0] = np.nextafter(flat[0], np.inf)


@pytest.mark.parametrize("part", ["pose", "coupled", "fill", "row_ends", "alive"])
def test_the_last_bit_of_every_part_counts(part):
    world = World(lay_out(Scenario()))
    ranges = Scanner(world).scan(world).ranges
    other = copy.deepcopy(world)
    _nudge(getattr(other, part))
    assert hash_of(other, ranges, {}) != hash_of(world, ranges, {})


def test_scans_deliveries_mail_and_all_ticks_before_count():
    """Each change of one of them gives another hash: no two of these are equal.

    `mail` has for each agent what it heard, as bytes; names and bytes must not run into each other.
    """
    world = World(lay_out(Scenario()))
    ranges = Scanner(world).scan(world).ranges
    hashes = [
        hash_of(world, ranges, mail)
        for mail in (
            {},
            {"a": b"xy"},
            {"a": b"x"},
            {"b": b"xy"},
            {"ax": b"y"},
            {"a": b"x", "b": b"y"},
        )
    ]
    changed = ranges.copy()
    changed[-1] = 9.0
    hashes += [hash_of(world, changed, {}), next_digest(bytes(31) + b"x", world, ranges, {}).hex()]
    world.delivered = 1
    hashes.append(hash_of(world, ranges, {}))
    assert len(set(hashes)) == len(hashes)


def test_mail_counts_by_name_and_not_by_arrival():
    world = World(lay_out(Scenario()))
    assert hash_of(world, NONE_SEEN, {"a": b"1", "b": b"2"}) == hash_of(
        world, NONE_SEEN, {"b": b"2", "a": b"1"}
    )
