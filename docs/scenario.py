"""The scenario in docs/reference.md: each value of a scenario with its default and its limits, from
the model that checks it.
"""

from collections.abc import Iterator
from typing import Any

from orchard.field.scenario import Scenario

HEAD = """\
## The scenario

A scenario is a YAML file. Each value that it leaves out keeps its default. `orchard FILE.yaml`
harvests it; options such as `--rows` and `--dispatch` change the value of the same name. These come
with the program; their files name their sources:

- `hand_picking`, `kiwi_robot`: a hectare of kiwifruit, picked by people and by robots;
- `cart_robots`: the hectare of `hand_picking` with small, fast carriers;
- `tractor_trailers`: two gangs pick kiwifruit, with tractors and trailers of three bins;
- `apple_platform`, `apple_robots`: a hectare of apples in close rows, picked by people on platforms
  and by robots;
- `forklift`: people pick apples, and a forklift takes four bins at a time to the store;
- `undisturbed`: nothing is random.

All faults of a file are reported at once, each with its line. The line
`# yaml-language-server: $schema=PATH` lets an editor complete the file; PATH leads to
[the schema](../{schema}).

```yaml scenario
rows: 8
pickers: 4
people: {{workers: 2, visitors: 0}}
```

{table}

The queue must have room for all carriers, which depends on `row_length`, `bay` and `route`. There
is at most one picker for each row, and a bin for each picker and each carrier. There are at most 50
people and 50 animals. `survey`, which
[`orchard layout import`](how-to.md#harvest-the-rows-of-a-real-orchard) writes, decides `rows` and
`row_length`. [Extend the Orchard](extending.md) describes the values that name classes."""
SCHEMA = "config/scenario.schema.json"
MACHINES = """\
### Machines: where their values come from

Numbers in brackets are those of [the sources of published figures](validation.md#sources).
"Chosen" is what no source tells: if your answer hangs on it, measure it.
`orchard study FILE --sensitivity` tells on what it hangs.

{table}

No preset is of a farm-ng Amiga: no source that we found tells its speed and its load."""
# Value -> where its default comes from, and where its limits do.
SOURCES = {
    "carrying.speed": (
        "chosen; a program for robots that carry strawberries has it too (validation.md)",
        "carts drive 2.2 m/s [15]; above 2.5 m/s with turns of 60 degrees/s a bin is further off"
        " its place than its bar allows; the least is chosen",
    ),
    "picking.driving_speed": (
        "as carrying.speed",
        "in that program people walk 0.8 to 1.5 m/s; as carrying.speed",
    ),
    "carrying.turning": (
        "the manual of 2015: pi/8 rad/s",
        "the most as that of carrying.speed; the least is chosen",
    ),
    "picking.turning": ("as carrying.turning", "as carrying.turning"),
    "handling.coupling": (
        "the least that physics allows",
        "people who change a bin on a platform take a minute [10]; the most is twice that",
    ),
    "handling.uncoupling": ("the least that physics allows", "as coupling"),
    "handling.exchange": ("chosen: none", "as coupling"),
    "handling.unloading": (
        "chosen",
        "chosen; at the most, a place of the bay unloads less than 12 bins an hour",
    ),
    "bays": ("chosen", "up to three are measured (traffic.md)"),
    "carrying.battery.hours": ("chosen: endless", "chosen: 3 minutes for tests, to a week"),
    "carrying.battery.hours_to_charge": ("chosen", "chosen: from a swap to two days"),
    "load_out.metres": (
        "none",
        "400 and 800 m [14]; lorries drive further, 5 km are chosen",
    ),
    "load_out.speed": ("none", "a walk to 54 km/h on a road; chosen"),
    "load_out.seconds_away": (
        "none",
        "ten minutes [1], and 771 to 926 s that were fitted to [13]; two hours are chosen",
    ),
    "load_out.trailers.bins": (
        "none",
        "3 [1], 4 to 12 [13], trains of 6 and trailers of 8 [14]; 40 are chosen",
    ),
    "load_out.trailers.count": ("none", "two for each gang [1]; 20 are chosen"),
    "load_out.truck.every": ("none", "chosen: a minute to a day"),
    "picking_rate": (
        "that of picking_speed",
        "0.56 bins of apples [7] to 1.8 of kiwifruit an hour [1]; wider, for robots and trays:"
        " chosen",
    ),
    "crop.kilograms_per_bin": (
        "none",
        "carts 226 kg [15], boxes 330 kg [13], bins 386 kg [7], trailers of three bins 1050 kg;"
        " chosen",
    ),
}


def section() -> str:
    """Return the section of docs/reference.md."""
    lines = [
        "| value | default; limits | meaning |",
        "|---|---|---|",
        *_lines(Scenario.model_json_schema()),
    ]
    head = HEAD.format(schema=SCHEMA, table="\n".join(lines))
    return f"{head}\n\n{MACHINES.format(table=_sources())}"


def _sources() -> str:
    """Return the table of machines: where their defaults and limits come from."""
    values = dict(_values(Scenario.model_json_schema()))
    lines = ["| value | default; limits | default from | limits from |", "|---|---|---|---|"]
    for name, (of_default, of_limits) in SOURCES.items():
        value = values[name]
        lines.append(
            f"| `{name}` | {_default(value)}; {_limits(value)} | {of_default} | {of_limits} |"
        )
    return "\n".join(lines)


def _lines(schema: dict[str, Any]) -> Iterator[str]:
    """Yield a line for each value."""
    for name, value in _values(schema):
        yield f"| `{name}` | {_default(value)}; {_limits(value)} | {value['description']} |"


def _values(
    schema: dict[str, Any], section: str = "", whole: dict[str, Any] | None = None
) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield each value with its schema; those of a section have dotted names.

    `schema`: of a section. `whole`: the schema with all definitions; None if `schema` is that.
    """
    whole = whole or schema
    for name, value in schema["properties"].items():
        if "$ref" in value:
            definition = whole["$defs"][value["$ref"].rsplit("/", 1)[1]]
            yield from _values(definition, f"{section}{name}.", whole)
        else:
            yield f"{section}{name}", value


def _default(value: dict[str, Any]) -> str:
    """Return the default of a value as YAML writes it."""
    default = value["default"]
    if default is None or isinstance(default, bool):
        default = {None: "null", True: "true", False: "false"}[default]
    return f"`{default}`"


def _limits(value: dict[str, Any]) -> str:
    """Return what a value may be. A value of several types has the limits of the first one."""
    kinds = [kind for kind in value.get("anyOf", [value]) if kind.get("type") != "null"]
    low, high = kinds[0].get("minimum"), kinds[0].get("maximum")
    words = {"boolean": "true or false", "string": "a text", "object": "a map", "array": "a list"}
    return words.get(kinds[0].get("type", "object"), f"{low} to {high}")
