"""The scenes of schedules: small orchards in which something happens often.

In each of them another part of the program is at work. A scene is the values of a scenario.
"""

from typing import Any

# Nothing but robots and bins.
ALONE: dict[str, Any] = {
    "people": {"workers": 0, "visitors": 0},
    "animals": {"dogs": 0, "cats": 0},
    "weeds": 0,
}
SMALL: dict[str, Any] = {
    "rows": 3,
    "row_length": 20.0,
    "pickers": 2,
    "carriers": 2,
    "tractor": False,
    "agents_without_body": {"idler": "chaos.simulated.talkers.Idler"},
    **ALONE,
}
# Agents with messages of types of their own: talkers.py.
TALKERS = {
    "asker": "chaos.simulated.talkers.Asker",
    "station": "chaos.simulated.talkers.Station",
}

SCENES: dict[str, dict[str, Any]] = {
    # the default policy and roads, with a tractor, and with messages of own types
    "rolling": SMALL
    | {
        "seed": 1,
        "tractor": True,
        "agents_without_body": SMALL["agents_without_body"] | TALKERS,
    },
    # bins call the carriers themselves, on one-way roads
    "nearest": SMALL
    | {"seed": 2, "dispatch": "nearest", "route": "one-way", "rows_to_pickers": "balanced"},
    # people, animals and weeds in the way
    "crowd": SMALL
    | {
        "seed": 3,
        "route": "one-way",
        "people": {"workers": 2, "visitors": 1},
        "animals": {"dogs": 1, "cats": 1},
        "weeds": 12,
    },
    # carriers that charge
    "batteries": SMALL
    | {
        "seed": 4,
        "row_length": 30.0,
        "carrying": {"battery": {"hours": 0.1, "hours_to_charge": 0.01, "reserve": 0.9}},
    },
    # robots that fail, and are repaired
    "failures": SMALL
    | {
        "seed": 5,
        "dispatch": "assignment",
        "picking_speed": 0.3,
        "weeds": 8,
        "picking": {"failure": {"mean_between": 60, "mean_repair": 2}},
        "carrying": {"failure": {"mean_between": 60, "mean_repair": 2}},
    },
    # several bins a row, which are picked from its middle to its ends
    "outward": SMALL
    | {"seed": 6, "bins_per_row": 1.5, "order_in_row": "outward", "dispatch": "predictive"},
    # several bins a row, with bins that call themselves, and errors of all sensors
    "nearest, several bins": SMALL
    | {
        "seed": 7,
        "metres_per_bin": 10.0,
        "order_in_row": "outward",
        "dispatch": "nearest",
        "sensors": {"odometry": {"distance": 0.001, "heading": 0.0005}},
        "laser": {"noise": 0.002},
    },
}
