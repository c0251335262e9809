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


def section() -> str:
    """Return the section of docs/reference.md."""
    lines = [
        "| value | default; limits | meaning |",
        "|---|---|---|",
        *_lines(Scenario.model_json_schema()),
    ]
    return HEAD.format(schema=SCHEMA, table="\n".join(lines))


def _lines(
    schema: dict[str, Any], section: str = "", whole: dict[str, Any] | None = None
) -> Iterator[str]:
    """A line for each value; those of a section have dotted names."""
    whole = whole or schema
    for name, value in schema["properties"].items():
        if "$ref" in value:
            yield from _lines(
                whole["$defs"][value["$ref"].rsplit("/", 1)[1]], f"{section}{name}.", whole
            )
        else:
            yield (
                f"| `{section}{name}` | {_default(value)}; {_limits(value)} |"
                f" {value['description']} |"
            )


def _default(value: dict[str, Any]) -> str:
    shown = {None: "null", True: "true", False: "false"}
    default = value["default"]
    return f"`{shown[default] if isinstance(default, bool | None) else default}`"


def _limits(value: dict[str, Any]) -> str:
    kinds = [kind for kind in value.get("anyOf", [value]) if kind.get("type") != "null"]
    low, high = kinds[0].get("minimum"), kinds[0].get("maximum")
    words = {"boolean": "true or false", "string": "a text", "object": "a map", "array": "a list"}
    return words.get(kinds[0].get("type", "object"), f"{low} to {high}")
