"""VDA 5050 2.1 and 2.0: what a vehicle says, in the words of those versions.

Fleet control's orders are read in the words of all versions.
"""

from collections.abc import Callable, Collection, Mapping

from orchard_vda5050.messages import Message

# Level of an error in version 3.0 -> the one that says the same in older versions.
LEVELS: Mapping[str, str] = {
    "WARNING": "WARNING",
    "URGENT": "WARNING",
    "CRITICAL": "FATAL",
    "FATAL": "FATAL",
}
# Type of an error in version 3.0 -> that of older versions. Any other one keeps its name.
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
}
# What a factsheet of an older version does not say of an action. By the schema of 2.1, no list of
# blocking types is valid.
UNSAID = ("pauseAllowed", "cancelAllowed", "blockingTypes")
# Fields of a state that have another place in older versions.
MOVED = ("mobileRobotPosition", "powerSupply", "instantActionStates")


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


def _without(message: Message, keys: Collection[str]) -> Message:
    """Return a message without some fields."""
    return {key: value for key, value in message.items() if key not in keys}


def _state(message: Message) -> Message:
    power = message["powerSupply"]
    safety = message["safetyState"]
    return _without(message, MOVED) | {
        "agvPosition": _position(message["mobileRobotPosition"]),
        "batteryState": {"batteryCharge": power["stateOfCharge"], "charging": power["charging"]},
        "actionStates": [*message["actionStates"], *message["instantActionStates"]],
        "errors": [_error(error) for error in message["errors"]],
        "information": [_information(info) for info in message["information"]],
        "safetyState": {
            "eStop": safety["activeEmergencyStop"],
            "fieldViolation": safety["fieldViolation"],
        },
    }


def _error(error: Message) -> Message:
    kind = error["errorType"]
    return error | {"errorType": ERRORS.get(kind, kind), "errorLevel": LEVELS[error["errorLevel"]]}


def _information(info: Message) -> Message:
    return {
        "infoType": info["infoType"],
        "infoLevel": info["infoLevel"],
        "infoDescription": info["infoDescriptor"],
    }


def _position(position: Message) -> Message:
    return _without(position, ["localized"]) | {"positionInitialized": position["localized"]}


def _visualization(message: Message) -> Message:
    return {
        "agvPosition": _position(message["mobileRobotPosition"]),
        "velocity": message["velocity"],
    }


def _factsheet(message: Message) -> Message:
    envelopes = message["mobileRobotGeometry"]["envelopes2d"]
    return {
        "typeSpecification": _type_specification(message["typeSpecification"]),
        "physicalParameters": _physical_parameters(message["physicalParameters"]),
        "protocolLimits": _protocol_limits(message["protocolLimits"]),
        "protocolFeatures": _protocol_features(message["protocolFeatures"]),
        "agvGeometry": {
            "envelopes2d": [
                {"set": envelope["envelope2dId"], "polygonPoints": envelope["vertices"]}
                for envelope in envelopes
            ]
        },
        "loadSpecification": message["loadSpecification"],
    }


def _type_specification(kind: Message) -> Message:
    return {
        "seriesName": kind["seriesName"],
        "seriesDescription": kind["seriesDescription"],
        "agvKinematic": "DIFF",
        "agvClass": kind["mobileRobotClass"],
        "maxLoadMass": kind["maximumLoadMass"],
        "localizationTypes": kind["localizationTypes"],
        "navigationTypes": kind["navigationTypes"],
    }


def _physical_parameters(physical: Message) -> Message:
    return {
        "speedMin": physical["minimumSpeed"],
        "speedMax": physical["maximumSpeed"],
        "accelerationMax": physical["maximumAcceleration"],
        "decelerationMax": physical["maximumDeceleration"],
        "heightMin": physical["minimumHeight"],
        "heightMax": physical["maximumHeight"],
        "width": physical["width"],
        "length": physical["length"],
    }


def _protocol_limits(limits: Message) -> Message:
    longest = limits["maximumStringLengths"]
    timing = limits["timing"]
    return {
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
    }


def _protocol_features(features: Message) -> Message:
    optional_parameters = []
    for optional in features["optionalParameters"]:
        name = optional["parameter"].replace("maximumSpeed", "maxSpeed")
        optional_parameters.append(optional | {"parameter": name})
    actions = [_without(action, UNSAID) for action in features["mobileRobotActions"]]
    return {"optionalParameters": optional_parameters, "agvActions": actions}


_WORDS: Mapping[str, Callable[[Message], Message]] = {
    "connection": _connection,
    "factsheet": _factsheet,
    "state": _state,
    "visualization": _visualization,
}
