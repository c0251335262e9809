"""The failures of docs/traffic.md: each scenario jams as it is, with the words that the page shows,
and finishes with its cure.
"""

import re

import pytest
from code_blocks import ROOT, block
from stage import Stage

from orchard.field.scenario import Scenario, parse
from orchard.fork.forked import forked
from orchard.futures.bisection import NEAR
from orchard.futures.moments import WatchedRun
from orchard.local import Local
from orchard.terminal.values import moment, value_of

PAGE = "docs/traffic.md"
FAILURES = ("head-on", "ring", "person", "early")


def scenario(name: str, cured: bool) -> Scenario:
    """Return a scenario of the document, as it is or with its cure.

    In the document a line as `route: one-way  # cured: two-way` has the cure.
    """
    text = block(PAGE, name)
    if cured:
        text, cures = re.subn(r": [^#\n]+# cured: (.+)$", r": \1", text, flags=re.M)
        assert cures == 1
    else:
        text = re.sub(r" +# cured.*", "", text)
    # The lines of the block `nobody` are for all of them, unless a scenario says otherwise.
    keys = [line.split(":")[0] for line in text.splitlines()]
    nobody = [line for line in block(PAGE, "nobody").splitlines() if line.split(":")[0] not in keys]
    return parse("\n".join([*nobody, text]))


@pytest.mark.parametrize("name", FAILURES)
def test_each_failure_is_cured(name):
    stage = Stage(scenario(name, cured=True))
    # s: more than each of them takes.
    stage.run_to_the_end(1500)
    assert stage.world.delivered == stage.world.layout.scenario.rows


@pytest.mark.parametrize("name", FAILURES)
def test_each_failure_was_decided_at_the_moment_of_the_page(name, request):
    """The page says the moment, what must be changed by then, and which robots wait in the jam.

    Changed at the moment the run is harvested; changed a little later, by NEAR ticks, it jams.
    """
    # `# decided: 1:20 with carriers=1`: moment, path and value.
    decided = re.search(r"# decided: (\S+) with ([a-z_]+)=(.+)", block(PAGE, name))
    section = (ROOT / PAGE).read_text().split(f"```yaml {name}\n")[1].split("\n### ")[0]
    shown = re.findall(r"^    (\w+ \(.*)$", section, re.M)
    assert decided
    assert shown
    run = WatchedRun(Local(scenario(name, cured=False)).snapshot(), is_hashed=False)

    def changed_at(tick):
        """Return how a fork ends that has the change from a tick on."""
        run.go_on(tick)
        fork = WatchedRun(
            forked(run.snapshot(), {decided[2]: value_of(decided[3])}), is_hashed=False
        )
        fork.go_on(20_000)
        return fork.ended

    assert changed_at(moment(decided[1])) == "harvested"
    # From here on a jam is told after two minutes: a harvest may pause for longer than that.
    request.getfixturevalue("soon_jammed")
    assert changed_at(moment(decided[1]) + NEAR) == "jammed"
    run.go_on(15_000)
    assert [line for line in shown if line not in run.figures.jam] == [], run.figures.jam
    assert run.local.engine.violations() == []
