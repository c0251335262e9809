"""VDA 5050 2.1 and 2.0: what a vehicle says, in the words of those versions.

Fleet control's orders are read in the words of all versions.
"""

from collections.abc import Callable, Mapping

from orchard_vda5050.messages import Message

LEVELS: Mapping[str, str] = {
    "WARNING": "WARNING",
    "URGENT": "WARNING",
    "CRITICAL": "FATAL",
    "FATAL": "FATAL",
}
ERRORS: Mapping[str, str] = {
    "VALIDATION_FAILURE": "validationError",
    "UNSUPPORTED_PARAMETER": "validationError",
    "NO_ROUTE_TO_TARGET": "noRouteError",
    "NODE_UNREACHABLE": "noRouteError",
    "UNKNOWN_MAP_ID": "noRouteError",
    "START_NODE_OUT_OF_RANGE": "noRouteError",
    "OUTDATED_ORDER_UPDATE": "orderUpdateError",
    "SAME_ORDER_UPDATE_ID": "orderUpdateError",
    "ORDER_UPDATE_FOLLOWING_CANCEL": "orderUpdateError",
    "OTHER_ORDER_ACTIVE": "orderError",
    "INVALID_ORDER_ACTION": "orderError",
    "INSUFFICIENT_MEMORY": "orderError",
    "MOBILE_ROBOT_NOT_AVAILABLE": "orderError",
    "NO_ORDER_TO_CANCEL": "noOrderToCancel",
}  # any other one keeps its name

UNSAID = (
    "pauseAllowed",
    "cancelAllowed",
    "blockingTypes",
)  # of an action; no list of blocking types is valid by the schema of 2.1


def older(topic: str, message: Message) -> Message:
    """Return a message of version 3.0 as one of version 2.1."""
    return _WORDS[topic](message)


def oldest(topic: str, message: Message) -> Message:
    """Return a message of version 3.0 as one of version 2.0."""
    words = older(topic, message)
    return _state_of_2_0(words) if topic == "state" else words


def _state_of_2_0(state: Message) -> Message:
    """Leave out of a state of version 2.1 what 2.0 does not know, or cannot know.

    It has no maps, and a position of a node needs an angle there, which no order says.
    """
    known = dict(state)
    known.pop("maps", None)
    known["nodeStates"] = [dict(node) for node in state["nodeStates"]]
    for node in known["nodeStates"]:
        node.pop("nodePosition", None)
    return known


def _connection(message: Message) -> Message:
    return {"connectionState": message["connectionState"].replace("_", "")}


def _state(message: Message) -> Message:
    power, safety = message["powerSupply"], message["safetyState"]
    same = {
        key: value
        for key, value in message.items()
        if key not in ("mobileRobotPosition", "powerSupply", "instantActionStates")
    }
    return same | {
        "agvPosition": _position(message["mobileRobotPosition"]),
        "batteryState": {"batteryCharge": power["stateOfCharge"], "charging": power["charging"]},
        "actionStates": [*message["actionStates"], *message["instantActionStates"]],
        "errors": [_error(error) for error in message["errors"]],
        "information": [
            {
                "infoType": info["infoType"],
                "infoLevel": info["infoLevel"],
                "infoDescription": info["infoDescriptor"],
            }
            for info in message["information"]
        ],
        "safetyState": {
            "eStop": safety["activeEmergencyStop"],
            "fieldViolation": safety["fieldViolation"],
        },
    }


def _error(error: Message) -> Message:
    kind = error["errorType"]
    return error | {"errorType": ERRORS.get(kind, kind), "errorLevel": LEVELS[error["errorLevel"]]}


def _position(position: Message) -> Message:
    return {key: value for key, value in position.items() if key != "localized"} | {
        "positionInitialized": position["localized"]
    }


def _visualization(message: Message) -> Message:
    return {
        "agvPosition": _position(message["mobileRobotPosition"]),
        "velocity": message["velocity"],
    }


def _factsheet(message: Message) -> Message:
    kind, physical, timing = (
        message["typeSpecification"],
        message["physicalParameters"],
        message["protocolLimits"]["timing"],
    )
    features, longest = (
        message["protocolFeatures"],
        message["protocolLimits"]["maximumStringLengths"],
    )
    return {
        "typeSpecification": {
            "seriesName": kind["seriesName"],
            "seriesDescription": kind["seriesDescription"],
            "agvKinematic": "DIFF",
            "agvClass": kind["mobileRobotClass"],
            "maxLoadMass": kind["maximumLoadMass"],
            "localizationTypes": kind["localizationTypes"],
            "navigationTypes": kind["navigationTypes"],
        },
        "physicalParameters": {
            "speedMin": physical["minimumSpeed"],
            "speedMax": physical["maximumSpeed"],
            "accelerationMax": physical["maximumAcceleration"],
            "decelerationMax": physical["maximumDeceleration"],
            "heightMin": physical["minimumHeight"],
            "heightMax": physical["maximumHeight"],
            "width": physical["width"],
            "length": physical["length"],
        },
        "protocolLimits": {
            "maxStringLens": {
                "msgLen": longest["maximumMessageLength"],
                "idLen": longest["maximumIdLength"],
            },
            "maxArrayLens": {},
            "timing": {
                "minOrderInterval": timing["minimumOrderInterval"],
                "minStateInterval": timing["minimumStateInterval"],
                "defaultStateInterval": timing["defaultStateInterval"],
            },
        },
        "protocolFeatures": {
            "optionalParameters": [
                optional | {"parameter": optional["parameter"].replace("maximumSpeed", "maxSpeed")}
                for optional in features["optionalParameters"]
            ],
            "agvActions": [
                {key: value for key, value in action.items() if key not in UNSAID}
                for action in features["mobileRobotActions"]
            ],
        },
        "agvGeometry": {
            "envelopes2d": [
                {"set": envelope["envelope2dId"], "polygonPoints": envelope["vertices"]}
                for envelope in message["mobileRobotGeometry"]["envelopes2d"]
            ]
        },
        "loadSpecification": message["loadSpecification"],
    }


_WORDS: Mapping[str, Callable[[Message], Message]] = {
    "connection": _connection,
    "factsheet": _factsheet,
    "state": _state,
    "visualization": _visualization,
}
