"""The same seed gives the same run, to the last bit: repeated, from the memory of any agent, and on any processor."""

import os
import subprocess
import sys

import pytest
from local_runs import HARVEST_TICKS, harvest_hash, local_hash, start_afresh

from orchard.field.scenario import LaserSettings, Scenario
from orchard.local import Local


def test_the_same_seed_gives_the_same_run_and_another_seed_another():
    hashes = [local_hash(Scenario(rows=3, seed=seed), 300) for seed in (1, 1, 2, 3, 4, 5)]
    assert hashes[0] == hashes[1]
    assert len(set(hashes)) == 5


def test_laser_noise_is_repeatable_and_part_of_the_run():
    noisy = Scenario(rows=3, laser=LaserSettings(noise=0.02))
    assert local_hash(noisy, 200) == local_hash(noisy, 200) != local_hash(Scenario(rows=3), 200)


def test_a_velocity_that_is_off_by_a_trillionth_changes_the_hash():
    class Touched:
        """A picker with another velocity at one tick. It promises nothing (`Hold`), so it is asked at each tick."""

        def __init__(self, agent, more) -> None:
            self.agent, self.Memory, self.more = agent, agent.Memory, more

        def tick(self, seen, mail, memory):
            action = self.agent.tick(seen, mail, memory)
            if seen.tick == 40:
                action.twist = action.twist._replace(x=action.twist.x + self.more)
            return action

    def hash_with(more):
        local = Local(Scenario(rows=3))
        local.play("picker_01", Touched(local.agents["picker_01"], more))
        for _ in range(60):
            local.tick()
        return local.engine.hash

    assert hash_with(0.0) == local_hash(Scenario(rows=3), 60)
    assert hash_with(-1e-12) != hash_with(0.0)


ASKED = {
    "the hash": lambda engine: engine.hash,
    "the snapshot's digest": lambda engine: engine.digest,
    "the snapshot's figures": lambda engine: engine.figures_as_data(),
    "the summary": lambda engine: engine.states.figures(),
    "violations": lambda engine: engine.violations(),
}


@pytest.mark.parametrize("asked", ASKED)
def test_a_step_that_is_accounted_for_later_counts_the_same(asked):
    at_once, later = Local(Scenario(rows=3)), Local(Scenario(rows=3))
    later.engine.advance = later.engine.step
    for tick in range(200):
        for local in (at_once, later):
            local.tick()
            if tick == 30:
                assert "picker_01" in local.engine.stop(["picker_01"]), "it drives, and stands from now on"
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


OTHER_PROCESSORS = {
    "numpy without AVX-512": {"NPY_DISABLE_CPU_FEATURES": "X86_V4"},
    "another BLAS": {"OPENBLAS_CORETYPE": "Nehalem"},
    "glibc without FMA and AVX2": {"GLIBC_TUNABLES": "glibc.cpu.hwcaps=-FMA,-FMA4,-AVX2,-AVX2_Usable,-FMA_Usable"},
    "compiled for any x86-64": {"NUMBA_CPU_NAME": "x86-64", "NUMBA_CPU_FEATURES": ""},
}


@pytest.mark.parametrize("processor", OTHER_PROCESSORS)
def test_the_hash_is_the_same_on_another_processor(processor, request):
    """Kernels for another processor are kept from one session of tests to the next, as those for this one are."""
    program = "from local_runs import harvest_hash; print(harvest_hash())"
    environment = os.environ | OTHER_PROCESSORS[processor] | {"PYTHONPATH": os.pathsep.join(sys.path)}
    if "NUMBA_CPU_NAME" in environment:
        environment["NUMBA_CACHE_DIR"] = str(request.config.cache.mkdir("kernels"))
    done = subprocess.run([sys.executable, "-c", program], env=environment, capture_output=True, text=True, timeout=120)
    assert done.stdout.strip() == harvest_hash(), done.stderr
