"""A carrier that is written from keyspace.md alone works a whole harvest."""

import re
import subprocess
import sys

import foreign_carrier
import pytest
from alone import SMALL
from fleet import ROOT

from orchard.contract.agent import Heard, Mail, Reply
from orchard.contract.mail import digest_of
from orchard.contract.messages import Call, Offer, Where, pack

HARVEST_SECONDS = 240.0  # of wall time, on a busy machine


def harvest(fleet, scenario) -> dict:
    """A harvest in which the foreign carrier is carrier_01: the last message."""
    fleet.physics(scenario, "--duration", "3600")
    client = fleet.client()
    ends = client.hear("orchard/end")
    fleet.host("--without", "carrier_01")
    command = [sys.executable, str(ROOT / "tests" / "foreign_carrier.py"), fleet.endpoint, "carrier_01"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=HARVEST_SECONDS, cwd=ROOT)
    assert done.returncode == 0, done.stdout + done.stderr
    fleet.end()
    return ends.get(timeout=1.0) | {"taken": done.stdout}


def assert_all_delivered(end, rows) -> None:
    summary = end["summary"]
    assert (end["why"], end["finished"], summary["violations"], summary["jam"]) == ("harvested", True, [], [])
    assert (summary["rows_picked"], summary["bins_delivered"], summary["collisions"]) == (rows, rows, 0)
    assert summary["messages_refused"] == {} and summary["broken_agents"] == []


def test_a_carrier_written_from_keyspace_alone_brings_in_the_harvest(fleet):
    end = harvest(fleet, SMALL)
    assert_all_delivered(end, SMALL.rows)
    assert end["taken"] == "3 bins taken\n"
