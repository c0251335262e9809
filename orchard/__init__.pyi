__all__ = [
    "Action",
    "Agent",
    "AgentMessage",
    "Assignment",
    "BinReport",
    "Block",
    "BusError",
    "Carrier",
    "CarrierMemory",
    "CarrierReport",
    "Couple",
    "Dispatch",
    "DriveTo",
    "Face",
    "Heard",
    "Hold",
    "Layout",
    "Local",
    "Mail",
    "MoveTo",
    "No",
    "Observation",
    "OneWay",
    "PickFrom",
    "Picker",
    "PickerMemory",
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
    "TwoWay",
    "Uncouple",
    "Wait",
    "Yes",
    "Zone",
    "connect",
    "draw",
    "lay_out",
    "load",
    "with_changes",
    "with_steps",
]

from .behaviour.carrier import Carrier, CarrierMemory
from .behaviour.picker import Picker, PickerMemory
from .contract.agent import Action, Agent, Heard, Hold, Mail, Observation, Reply, State
from .contract.messages import AgentMessage, Couple, No, PickFrom, Uncouple, Yes
from .contract.zone import Zone
from .dispatch.policy import Assignment, BinReport, CarrierReport, Dispatch
from .field.geometry import Pose, Twist
from .field.layout import Layout, lay_out
from .field.problems import ScenarioError
from .field.repeatable import draw
from .field.rows import Block
from .field.scenario import Scenario, load, with_changes
from .local import Local
from .net.endpoints import BusError
from .plans.robot import PlanExecutor, Step
from .plans.route import OneWay, Side
from .plans.steps import DriveTo, Face, MoveTo, Say, Wait, with_steps
from .plans.two_way import TwoWay
from .remote import Remote, connect
from .sim.snapshot import Snapshot, SnapshotError
