"""A run in lockstep is the same with and without a bridge that listens."""

import json
import os
import shlex
import subprocess

from conftest import BEGIN_SECONDS, scene
from rosgraph_msgs.msg import Clock

RUN = ["--rows", "3", "--mode", "lockstep", "--duration", "30"]


def hash_in(summary):
    """Return the hash of a run."""
    return json.loads(summary.read_text())["hash"]


def test_the_hash_is_that_of_the_run_without_a_bridge(tmp_path):
    """The bridge only listens. The same run is done with it, and then alone."""
    with_bridge = tmp_path / "with.json"
    without = tmp_path / "without.json"
    with scene(tmp_path, [*RUN, "--speed", "4", "--summary", str(with_bridge)], []) as run:
        clock = run.user.hear("clock", Clock, 100)
        run.user.until(lambda: len(clock) > 20, BEGIN_SECONDS)
        run.user.until(lambda: run.orchard.poll() is not None, BEGIN_SECONDS, needs_bridge=False)
    words = [*shlex.split(os.environ["ORCHARD"]), *RUN]
    words += ["--record", "none", "--summary", str(without)]
    alone = os.environ | {"ORCHARD_RUNS": str(tmp_path / "runs")}
    subprocess.run(
        words, cwd=tmp_path, env=alone, check=True, capture_output=True, timeout=BEGIN_SECONDS
    )
    assert hash_in(with_bridge) == hash_in(without)
