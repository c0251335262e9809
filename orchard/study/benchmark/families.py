"""The families of the benchmark's orchards, and how a secret draws an orchard of each family.

A split has one orchard of each family. The secrets of the public splits stand below. The organiser
of a competition keeps the secret of the hidden split, and publishes it after the last submission.
The same secret gives the same orchards (see `orchard.study.benchmark.hidden_draws` for an
exception).
"""

import hashlib
import hmac
from typing import Any

from orchard.study.benchmark.instances import SET, Split

PUBLIC_SECRETS: dict[Split, bytes] = {
    "train": f"orchard benchmark {SET}, train".encode(),
    "test": f"orchard benchmark {SET}, test".encode(),
}
# Values of all families, unless a family has its own. Of a list the secret draws one value.
ALL: dict[str, Any] = {
    "people": {"workers": 0, "visitors": 0},
    "animals": {"dogs": 0, "cats": 0},
    "tractor": False,
    "weeds": 0,
    "row_length": [60.0, 70.0, 80.0],
    "rows_to_pickers": ["balanced", "balanced-ends"],
    "route": "two-way",
}
_GUESTS = {
    "people": {"workers": [2, 4, 6], "visitors": [2, 3]},
    "animals": {"dogs": [1, 2], "cats": 1},
    "tractor": True,
}
_BREAKDOWNS = {"failure": {"mean_between": [600.0, 900.0, 1200.0], "mean_repair": [60.0, 120.0]}}
FAMILIES: dict[str, dict[str, Any]] = {
    # Two bins a row. With one bin a row all policies that send carriers early do the same here.
    "tiny": {
        "rows": 4,
        "pickers": 4,
        "carriers": 2,
        "metres_per_bin": 40.0,
        "row_length": [60.0, 80.0],
        "picking_speed": [0.3, 0.4, 0.5],
    },
    "small-fast": {"rows": [8, 10, 12], "pickers": 5, "carriers": [3, 4], "picking_speed": 1.0},
    "small-one-way": {
        "rows": [10, 12],
        "pickers": 5,
        "carriers": [3, 4],
        "picking_speed": [0.6, 0.8, 1.0],
        "route": "one-way",
    },
    "small-slow": {"rows": 10, "pickers": 5, "carriers": 2, "picking_speed": [0.03, 0.05]},
    "small-people": {"rows": [8, 10], "pickers": 5, "carriers": [3, 4], "picking_speed": 0.5}
    | _GUESTS,
    "small-failures": {
        "rows": 10,
        "pickers": 5,
        "carriers": [3, 4],
        "picking_speed": [0.2, 0.3],
        "carrying": _BREAKDOWNS,
    },
    "small-spread": {
        "rows": [10, 12],
        "pickers": 4,
        "carriers": [2, 3],
        "picking_speed": [0.1, 0.2],
        "picking": {"spread": {"distribution": ["lognormal", "gamma"], "cv": [0.2, 0.3]}},
    },
    "small-batteries": {
        "rows": [10, 12],
        "pickers": 5,
        "carriers": 3,
        "picking_speed": [0.2, 0.3],
        "carrying": {"battery": {"hours": [0.3, 0.4], "hours_to_charge": 0.1, "reserve": 0.5}},
        "chargers": [1, 2],
    },
    "small-bins": {
        "rows": 8,
        "pickers": 4,
        "carriers": [3, 4],
        "metres_per_bin": [20.0, 30.0],
        "picking_speed": [0.3, 0.5],
    },
    "swift-carriers": {
        "rows": 12,
        "pickers": 6,
        "carriers": [3, 4],
        "picking_speed": [0.5, 1.0],
        "carrying": {"speed": [1.5, 2.0]},
        "picking": {"driving_speed": [1.2, 1.5]},
    },
    "slow-handling": {
        "rows": 12,
        "pickers": 6,
        "carriers": [4, 5],
        "picking_speed": [0.5, 1.0],
        "handling": {"coupling": [5.0, 10.0], "uncoupling": 5.0, "unloading": [20.0, 30.0]},
    },
    "wide-rows": {
        "rows": 12,
        "pickers": 6,
        "carriers": [3, 4, 5],
        "picking_speed": [0.5, 1.0],
        "row_width": [4.5, 5.0],
    },
    # As in close plantings, between which a robot just fits.
    "close-rows": {
        "rows": 12,
        "pickers": 6,
        "carriers": [3, 4],
        "picking_speed": [0.5, 1.0],
        "row_width": [3.15, 3.3, 3.5],
    },
    # Small carriers that bring each bin to the load-out themselves.
    "load-out": {
        "rows": 12,
        "pickers": 5,
        "carriers": [5, 6],
        "picking_speed": [0.3, 0.5],
        "carrying": {"speed": [1.2, 1.5]},
        "load_out": {"metres": [100.0, 200.0], "speed": [2.0, 3.0], "seconds": 30.0},
    },
    # Trailers stand at the bay, and carriers wait while none does.
    "trailers": {
        "rows": 12,
        "pickers": 5,
        "carriers": 3,
        "picking_speed": [0.4, 0.6],
        "load_out": {
            "metres": [300.0, 400.0],
            "speed": 4.0,
            "seconds": [60.0, 90.0],
            "trailers": {"count": 2, "bins": [2, 3]},
        },
    },
    "large-fast": {"rows": 20, "pickers": 10, "carriers": [7, 8], "picking_speed": [0.8, 1.0]},
    "large-slow": {
        "rows": 20,
        "pickers": 10,
        "carriers": 3,
        "picking_speed": [0.03, 0.04],
        "picking": {"spread": {"distribution": "lognormal", "cv": 0.2}},
    },
    "large-people": {"rows": 20, "pickers": 10, "carriers": [6, 7], "picking_speed": [0.3, 0.5]}
    | _GUESTS,
    "all-together": {
        "rows": 16,
        "pickers": 8,
        "carriers": [5, 6],
        "metres_per_bin": [35.0, 40.0],
        "picking_speed": [0.2, 0.3],
        "picking": {"spread": {"distribution": "gamma", "cv": 0.3}},
        "carrying": _BREAKDOWNS
        | {"battery": {"hours": 0.6, "hours_to_charge": 0.2, "reserve": 0.4}},
        "chargers": 2,
    }
    | _GUESTS,
}


def scenarios_of(split: Split, secret: bytes) -> dict[str, dict[str, Any]]:
    """Return the scenarios of a split: name -> values. They are the first draws, and each has its
    first seed.
    """
    drawn = {}
    for family in FAMILIES:
        name = name_of(family, split)
        drawn[name] = scenario_of(family, split, secret, 0)
    return drawn


def name_of(family: str, split: Split) -> str:
    """Return the name of the orchard of a family and a split."""
    return f"{family}-{split}"


def scenario_of(family: str, split: Split, secret: bytes, again: int) -> dict[str, Any]:
    """Return the scenario of a family that a secret draws.

    `again`: 0 for the first draw; other numbers give other draws.
    """
    key = name_of(family, split)
    if again > 0:
        key = f"{key}, drawn again {again}"
    drawn: dict[str, Any] = _chosen(ALL | FAMILIES[family], secret, key)
    # 52 bits of the 64. Readers of JSON that have floats only can hold such a number.
    drawn["seed"] = _number(secret, f"{key}, seed") >> 12
    return drawn


def commitment(secret: bytes) -> str:
    """Return the SHA-256 of a secret, which an organiser publishes before the first submission.

    It proves later that the secret was this one. Nobody can compute the orchards from it, because
    they are drawn by HMAC with the secret itself.
    """
    return hashlib.sha256(secret).hexdigest()


def _chosen(values: Any, secret: bytes, name: str) -> Any:
    """Return values with each list replaced by one of its elements. `name`: decides which one."""
    if isinstance(values, dict):
        return {key: _chosen(value, secret, f"{name}.{key}") for key, value in values.items()}
    if isinstance(values, list):
        return values[_number(secret, name) % len(values)]
    return values


def _number(secret: bytes, name: str) -> int:
    """Return a number of 64 bits that follows from a secret and a name."""
    return int.from_bytes(hmac.digest(secret, name.encode(), "sha256")[:8], "big")
