__all__ = [
    "Action",
    "Agent",
    "BusError",
    "Heard",
    "Layout",
    "Local",
    "Mail",
    "Observation",
    "Pose",
    "Remote",
    "Reply",
    "Scenario",
    "ScenarioError",
    "Snapshot",
    "SnapshotError",
    "Twist",
    "connect",
    "lay_out",
    "load",
    "with_changes",
]

from .contract.agent import Action, Agent, Heard, Mail, Observation, Reply
from .field.geometry import Pose, Twist
from .field.layout import Layout, lay_out
from .field.problems import ScenarioError
from .field.scenario import Scenario, load, with_changes
from .local import Local
from .net.endpoints import BusError
from .remote import Remote, connect
from .sim.snapshot import Snapshot, SnapshotError
