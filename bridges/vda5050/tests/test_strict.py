"""VDA 5050 2.0: a client of others, the npm package vda-5050-lib, drives a carrier over a real
broker.
"""

import json
import os
import subprocess
import sys
from itertools import pairwise
from pathlib import Path

from master import Master
from orchards import SMALL

from processes import broker, free_port, lif, scene

CLIENT = Path(__file__).with_name("strict_client.js")
HERE = Path(sys.prefix)  # where `.ci/ecosystem` has installed Node.js, and what package.json names
SECONDS = 300.0  # that the client may take on a busy machine
BRIDGE = ("--version", "2.0.0", "--interface", "uagv")


def test_a_strict_client_of_version_2_0_drives_a_carrier(tmp_path):
    port = free_port()
    with (
        broker(tmp_path, port),
        scene(tmp_path, SMALL, port, ("--mode", "realtime", "--speed", "4"), BRIDGE) as run,
    ):
        master = Master(lif(tmp_path), send=None)
        names = master.way("queue/1", "east/stop/1")
        job = {
            "broker": f"mqtt://127.0.0.1:{port}",
            "names": names,
            "edges": [master.edges[pair] for pair in pairwise(names)],
        }
        done = subprocess.run(
            [HERE / "bin" / "node", CLIENT, json.dumps(job)],
            env=os.environ | {"NODE_PATH": str(HERE / "node" / "node_modules")},
            capture_output=True,
            text=True,
            timeout=SECONDS,
        )
        assert done.returncode == 0, done.stdout + done.stderr + run.bridge_log()
    assert done.stderr == ""  # where it says which messages it drops
    # The client writes a line of JSON for each thing that it hears of.
    lines = [json.loads(line) for line in done.stdout.splitlines()]
    assert {"factsheet": "orchard-carrier"} in lines
    assert not any(line.get("error") for line in lines), lines
    reached = [line["traversed"] for line in lines if "traversed" in line]
    assert reached[: len(names) - 1] == names[:-1]
    # The order and its two updates. It is active until it is cancelled, after the second one.
    processed = [(line["processed"], line["active"]) for line in lines if "processed" in line]
    assert processed == [(0, True), (1, True), (2, False)]
    assert [line["is"] for line in lines if "action" in line][-1:] == ["FINISHED"]
