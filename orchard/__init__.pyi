__all__ = [
    "Action",
    "Agent",
    "AgentMessage",
    "Assignment",
    "BinReport",
    "BusError",
    "Carrier",
    "CarrierReport",
    "Dispatch",
    "DriveTo",
    "Face",
    "Heard",
    "Layout",
    "Local",
    "Mail",
    "MoveTo",
    "Observation",
    "OneWay",
    "Picker",
    "PlanExecutor",
    "Pose",
    "Remote",
    "Reply",
    "Say",
    "Scenario",
    "ScenarioError",
    "Side",
    "Snapshot",
    "SnapshotError",
    "State",
    "Step",
    "Twist",
    "Wait",
    "connect",
    "lay_out",
    "load",
    "with_changes",
]

from .agents.carrier import Carrier
from .agents.dispatch import Assignment, BinReport, CarrierReport, Dispatch
from .agents.picker import Picker
from .agents.robot import PlanExecutor, Step
from .agents.route import OneWay, Side
from .agents.steps import DriveTo, Face, MoveTo, Say, Wait
from .contract.agent import Action, Agent, Heard, Mail, Observation, Reply, State
from .contract.messages import AgentMessage
from .field.geometry import Pose, Twist
from .field.layout import Layout, lay_out
from .field.problems import ScenarioError
from .field.scenario import Scenario, load, with_changes
from .local import Local
from .net.endpoints import BusError
from .remote import Remote, connect
from .sim.snapshot import Snapshot, SnapshotError
