"""The messages of a vehicle as the tables of VDA 5050 3.0 describe them: with a field too few, too
many or of another type, one is wrong.

`check` uses the JSON schemas of the standard too, if VDA5050_SCHEMAS names the folder with them:
`json_schemas` of VDA5050/VDA5050 on GitHub.
"""

import json
import os
from datetime import datetime
from functools import cache
from pathlib import Path
from typing import Annotated, Literal

import msgspec
from jsonschema import Draft202012Validator
from msgspec import Meta

SCHEMAS = os.environ.get("VDA5050_SCHEMAS")
Count = Annotated[int, Meta(ge=0, lt=2**32)]
Angle = Annotated[float, Meta(ge=-3.1415926536, le=3.1415926536)]
Positive = Annotated[float, Meta(ge=0.0)]


class Part(msgspec.Struct, forbid_unknown_fields=True, kw_only=True, omit_defaults=True):
    """A part of a message."""


class Message(Part):
    headerId: Count
    timestamp: datetime
    version: Annotated[str, Meta(pattern=r"^3\.\d+\.\d+$")]
    manufacturer: str
    serialNumber: Annotated[str, Meta(pattern=r"^[A-Za-z0-9_.:-]+$")]


class Connection(Message):
    connectionState: Literal["ONLINE", "OFFLINE", "HIBERNATING", "CONNECTION_BROKEN"]


class Position(Part):
    x: float
    y: float
    theta: Angle
    mapId: str
    localized: bool
    localizationScore: float | None = None
    deviationRange: Positive | None = None


class Velocity(Part):
    vx: float | None = None
    vy: float | None = None
    omega: float | None = None


class Visualization(Message):
    referenceStateHeaderId: Count
    mobileRobotPosition: Position | None = None
    velocity: Velocity | None = None


class MapState(Part):
    mapId: str
    mapVersion: str
    mapStatus: Literal["ENABLED", "DISABLED"]


class NodePosition(Part):
    x: float
    y: float
    mapId: str
    theta: Angle | None = None


class NodeState(Part):
    nodeId: str
    sequenceId: Count
    released: bool
    nodePosition: NodePosition | None = None


class EdgeState(Part):
    edgeId: str
    sequenceId: Count
    released: bool


class Reference(Part):
    x: float
    y: float
    z: float


class Dimensions(Part):
    length: Positive
    width: Positive
    height: Positive | None = None


class Load(Part):
    loadId: str
    loadType: str
    loadPosition: str
    boundingBoxReference: Reference
    loadDimensions: Dimensions


class ActionState(Part):
    actionId: str
    actionStatus: Literal[
        "WAITING", "INITIALIZING", "RUNNING", "PAUSED", "RETRIABLE", "FINISHED", "FAILED"
    ]
    actionType: str | None = None


class Power(Part):
    stateOfCharge: Annotated[float, Meta(ge=0.0, le=100.0)]
    charging: bool


class KeyValue(Part):
    referenceKey: str
    referenceValue: str


class Error(Part):
    errorType: str
    errorLevel: Literal["WARNING", "URGENT", "CRITICAL", "FATAL"]
    errorReferences: list[KeyValue] = []
    errorDescription: str = ""


class Info(Part):
    infoType: str
    infoLevel: Literal["INFO", "DEBUG"]
    infoDescriptor: str = ""


class Safety(Part):
    activeEmergencyStop: Literal["MANUAL", "REMOTE", "NONE"]
    fieldViolation: bool


class State(Message):
    maps: list[MapState]
    orderId: str
    orderUpdateId: Count
    lastNodeId: str
    lastNodeSequenceId: Count
    nodeStates: list[NodeState]
    edgeStates: list[EdgeState]
    driving: bool
    actionStates: list[ActionState]
    instantActionStates: list[ActionState]
    powerSupply: Power
    operatingMode: Literal[
        "AUTOMATIC", "SEMIAUTOMATIC", "INTERVENED", "MANUAL", "STARTUP", "SERVICE", "TEACH_IN"
    ]
    errors: list[Error]
    information: list[Info]
    safetyState: Safety
    mobileRobotPosition: Position
    velocity: Velocity
    loads: list[Load]
    paused: bool
    newBaseRequest: bool
    distanceSinceLastNode: Positive


class TypeSpecification(Part):
    seriesName: str
    seriesDescription: str
    mobileRobotKinematics: str
    mobileRobotClass: str
    maximumLoadMass: Positive
    localizationTypes: list[str]
    navigationTypes: list[str]


class Physical(Part):
    minimumSpeed: Positive
    maximumSpeed: Positive
    maximumAngularSpeed: Positive
    maximumAcceleration: Positive
    maximumDeceleration: Positive
    minimumHeight: Positive
    maximumHeight: Positive
    width: Positive
    length: Positive


class TimeLimits(Part):
    minimumOrderInterval: Positive
    minimumStateInterval: Positive
    defaultStateInterval: Positive


class Limits(Part):
    maximumStringLengths: dict[str, int]
    maximumArrayLengths: dict[str, int]
    timing: TimeLimits


class Optional(Part):
    parameter: str
    support: Literal["SUPPORTED", "REQUIRED"]
    description: str = ""


class ActionParameter(Part):
    key: str
    valueDataType: Literal["BOOL", "NUMBER", "INTEGER", "STRING", "OBJECT", "ARRAY"]
    description: str
    isOptional: bool


class ActionOffered(Part):
    actionType: str
    actionDescription: str
    actionScopes: list[Literal["INSTANT", "NODE", "EDGE", "ZONE"]]
    actionParameters: list[ActionParameter]
    blockingTypes: list[Literal["NONE", "SOFT", "SINGLE", "HARD"]]
    pauseAllowed: bool
    cancelAllowed: bool


class Features(Part):
    optionalParameters: list[Optional]
    mobileRobotActions: list[ActionOffered]


class Vertex(Part):
    x: float
    y: float


class Envelope(Part):
    envelope2dId: str
    vertices: list[Vertex]


class Geometry(Part):
    envelopes2d: list[Envelope]


class LoadSet(Part):
    setName: str
    loadType: str
    loadPositions: list[str]
    boundingBoxReference: Reference
    loadDimensions: Dimensions


class LoadSpecification(Part):
    loadPositions: list[str]
    loadSets: list[LoadSet]


class Factsheet(Message):
    typeSpecification: TypeSpecification
    physicalParameters: Physical
    protocolLimits: Limits
    protocolFeatures: Features
    mobileRobotGeometry: Geometry
    loadSpecification: LoadSpecification


TYPES = {
    "state": State,
    "visualization": Visualization,
    "connection": Connection,
    "factsheet": Factsheet,
}


@cache
def _schema(topic):
    return Draft202012Validator(json.loads((Path(SCHEMAS) / f"{topic}.schema").read_text()))


def check(topic, message):
    """Raise an error for a message that is not as the standard has it."""
    if topic in TYPES:
        msgspec.convert(message, TYPES[topic])
    if SCHEMAS:
        _schema(topic).validate(message)
