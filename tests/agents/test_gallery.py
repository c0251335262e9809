"""The failures of docs/traffic.md: each scenario jams as it is, with the words that the page shows, and finishes with its cure."""

import re

import pytest
from code_blocks import ROOT, block
from stage import Stage

from orchard.field.scenario import Scenario, parse
from orchard.fork import forked
from orchard.launch.fork import WatchedRun
from orchard.launch.futures import NEAR
from orchard.launch.options import _moment as moment
from orchard.local import Local
from orchard.study.settings import value_of

PAGE = "docs/traffic.md"
FAILURES = ("head-on", "ring", "person", "early")


def scenario(name: str, cured: bool) -> Scenario:
    text = block(PAGE, name)
    if cured:
        text, cures = re.subn(r": [^#\n]+# cured: (.+)$", r": \1", text, flags=re.M)
        assert cures == 1
    else:
        text = re.sub(r" +# cured.*", "", text)
    keys = [line.split(":")[0] for line in text.splitlines()]
    nobody = [line for line in block(PAGE, "nobody").splitlines() if line.split(":")[0] not in keys]
    return parse("\n".join([*nobody, text]))


@pytest.mark.parametrize("name", FAILURES)
def test_each_failure_jams_and_says_how(name):
    stage = Stage(scenario(name, cured=False))
    stage.run_until(lambda: bool(stage.account.jam), 1500)
    section = (ROOT / PAGE).read_text().split(f"```yaml {name}\n")[1].split("\n### ")[0]
    shown = re.findall(r"^    (\w+ \(.*)$", section, re.M)
    assert shown
    assert [line for line in shown if line not in stage.account.jam] == [], stage.account.jam
    assert stage.local.engine.violations() == []


@pytest.mark.parametrize("name", FAILURES)
def test_each_failure_is_cured(name):
    stage = Stage(scenario(name, cured=True))
    stage.run_to_the_end(1500)
    assert stage.world.delivered == stage.world.layout.scenario.rows


@pytest.mark.parametrize("name", FAILURES)
def test_each_failure_was_decided_at_the_moment_that_the_page_says(name):
    found = re.search(r"# decided: (\S+) with ([a-z_]+)=(.+)", block(PAGE, name))
    assert found
    run = WatchedRun(Local(scenario(name, cured=False)).snapshot(), is_hashed=False)
    for tick, end in ((moment(found[1]), "harvested"), (moment(found[1]) + NEAR, "jammed")):
        run.go_on(tick)
        fork = WatchedRun(forked(run.snapshot(), {found[2]: value_of(found[3])}), is_hashed=False)
        fork.go_on(20_000)
        assert fork.ended == end
