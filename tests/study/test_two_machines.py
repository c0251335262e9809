"""A study whose runs are done on two machines: network namespaces with a cable between them."""

import json
import os
import subprocess
import sys
from contextlib import ExitStack

from command_line import ROOT, SECONDS, orchard
from machines import machines, needs_machines, within
from test_workers import PATIENCE, dask_process

QUESTION = ("--vary", "carriers=1,2", "--model", "fast", "--budget", "2h", "--within", "10%")
SCENARIO = "rows: 3\npicking_speed: 0.5\npicking: {spread: {distribution: gamma}}\n"
ADDRESS = "tcp://192.168.1.10:8786"


@needs_machines
def test_two_machines_give_the_same_table_as_one(tmp_path):
    (tmp_path / "my.yaml").write_text(SCENARIO)
    here = orchard("study", tmp_path / "my.yaml", *QUESTION, "--out", tmp_path / "here.db", "--summary", tmp_path / "here.json")
    assert here.returncode == 0, here.stderr
    with machines("study") as (host, guest), ExitStack() as stack:
        for machine, module, *arguments in (
            (host, "dask_scheduler", "--host", "192.168.1.10", "--port", 8786, "--no-dashboard", "--no-show"),
            (host, "dask_worker", ADDRESS, "--no-nanny", "--nthreads", 1, "--no-dashboard", "--local-directory", tmp_path / "a"),
            (guest, "dask_worker", ADDRESS, "--no-nanny", "--nthreads", 1, "--no-dashboard", "--local-directory", tmp_path / "b"),
        ):
            process = dask_process(module, *arguments, before=tuple(within(machine)))
            stack.callback(process.wait, PATIENCE)
            stack.callback(process.kill)
        wait_for_workers(host)
        options = ["--out", tmp_path / "there.db", "--summary", tmp_path / "there.json", "--scheduler", ADDRESS]
        command = [*within(host), sys.executable, "run.py", "study", tmp_path / "my.yaml", *QUESTION, *options]
        there = subprocess.run([*map(str, command)], cwd=ROOT, capture_output=True, text=True, timeout=SECONDS)
        assert there.returncode == 0, there.stderr
    tables = [json.loads((tmp_path / name).read_text())["table"] for name in ("here.json", "there.json")]
    assert tables[0] == tables[1]


def wait_for_workers(machine: str) -> None:
    """Wait until both workers are there."""
    script = (
        "import sys; from distributed import Client\n"
        "with Client(sys.argv[1], timeout=60) as client: client.wait_for_workers(2, timeout=60)\n"
    )
    subprocess.run([*within(machine), sys.executable, "-c", script, ADDRESS], check=True, timeout=PATIENCE, env=os.environ)
