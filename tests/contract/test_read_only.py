"""What an agent is given is read-only in every mode: it changes neither the world nor another
agent.
"""

import re
from dataclasses import dataclass, field

import numpy as np
import own_agents
import pytest
from local_runs import SMALL, driven_by, local_hash, played
from stage import Acting

from orchard.contract.agent import Action
from orchard.contract.messages import Claim
from orchard.field.layout import lay_out
from orchard.local import Local
from orchard.remote import connect
from orchard.wire import codec

ADVICE = (
    "What an agent is given is read-only. To change ranges, take a copy: scan ="
    " observation.scan.copy()"
)


def arrays_of(seen):
    """Return the arrays of an observation."""
    return [seen.scan] + (
        [seen.hitch.scan] if seen.hitch is not None and seen.hitch.scan is not None else []
    )


def over_the_wire(observations):
    """Return observations as they arrive over the network."""
    return codec.observations_of(codec.seen_of("run", observations, list(observations.names), []))


@pytest.mark.parametrize(
    "observed", [lambda observations: observations.of(observations.names), over_the_wire]
)
def test_no_observation_can_be_changed_in_place(observed):
    for seen in observed(Local(SMALL).engine.observe()).values():
        for scan in arrays_of(seen):
            with pytest.raises(ValueError, match="read-only"):
                scan[np.isinf(scan)] = 30
            for array in (scan, scan.base):
                with pytest.raises((ValueError, TypeError), match=r"WRITEABLE|setflags|read-only"):
                    np.asarray(array).setflags(write=True)
        for thing in filter(None, (seen, seen.pose, seen.twist, seen.hitch)):
            with pytest.raises(AttributeError):
                thing.x = 1.0
        with pytest.raises(AttributeError):
            seen.pose = None


def test_the_layout_that_all_agents_share_cannot_be_changed():
    layout = lay_out(SMALL)
    with pytest.raises(ValueError, match="read-only"):
        layout.walls[:] = 0.0
    for table in (layout.blocks, layout.index):
        with pytest.raises(TypeError, match="mappingproxy"):
            table["picker_01"] = None


@dataclass
class Meddler(own_agents.Eastward):
    """An agent that changes what it is given: the shape of its scans, its mail, or its scan."""

    what: str
    Memory = dict
    failed: list = field(default_factory=list)

    def tick(self, observation, mail, memory):
        if self.what == "shape":
            observation.scan.shape = (-1, 2)
            observation.hitch.scan.shape = (-1, 2)
        elif self.what == "mail":
            for heard in mail.requests:
                getattr(heard.body, "keep", []).append("row 99")
            mail.requests.clear()
        else:
            observation.scan[np.isinf(observation.scan)] = 30
        return Action(memory=memory)


def test_the_shape_that_an_agent_gives_its_scan_is_its_own():
    local = played(SMALL, 3, picker_01=Meddler("shape"))
    assert local.actions["picker_01"].state != "broken"
    assert [scan.shape for scan in local.engine.scans] == [
        scan.shape for scan in Local(SMALL).engine.observe().scans
    ]


def test_an_agent_that_changes_its_mail_changes_no_hash():
    """At the traffic desk stands an agent that does nothing, and then one that changes its mail."""
    hashes = set()
    for traffic in (own_agents.Eastward(None, "traffic"), Meddler("mail")):
        local = Local(SMALL)
        local.play("traffic", traffic)
        local.play(
            "picker_01", Acting(lambda *_: Action(requests=[("traffic", Claim(["row 1"], [], ""))]))
        )
        for _ in range(5):
            local.tick()
            assert local.actions["traffic"].state != "broken"
            assert "row 99" not in str(local.post.written)
        hashes.add(local.engine.hash)
    assert len(hashes) == 1


def test_writing_into_a_scan_is_explained_in_local_mode(caplog):
    local = played(SMALL, 1, picker_01=Meddler("scan"))
    assert local.actions["picker_01"].state == "broken"
    (record,) = caplog.records
    assert re.search(
        rf"picker_01 raised an error at tick 0.*\n(.|\n)*read-only\n  {re.escape(ADVICE)}",
        record.getMessage(),
    )


@pytest.mark.processes
@pytest.mark.parametrize("mode", ["lockstep", "realtime"])
def test_writing_into_a_scan_is_explained_over_the_network(fleet, mode, caplog):
    """One `Scribbler` is named by the scenario, and the other one joins from this process."""
    named = driven_by(picker_01="Scribbler")
    fleet.physics(named, "--duration", "1", "--mode", mode)
    host = fleet.host("--without", "picker_02")
    with connect(fleet.endpoint) as orchard:
        orchard.play("picker_02", own_agents.Scribbler(None, "picker_02"))
    code, out, _ = fleet.world.end()
    assert code == 1, "agents are broken"
    assert ADVICE in host.end()[2]
    assert ADVICE in caplog.text
    if mode == "lockstep":
        assert f"hash {local_hash(driven_by(picker='Scribbler'), 10)}" in out
