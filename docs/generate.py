"""Writes every file that is generated from the code: keyspace.md, docs/reference.md, docs/scenario.md, the JSON schema, and drawings."""

from pathlib import Path

from docs import keyspace, reference, scenario
from orchard.field.layout import lay_out
from orchard.field.scenario import Scenario, schema_text
from orchard.report.plan import exchange_plan, orchard_plan

ROOT = Path(__file__).parent.parent


def generated() -> dict[str, str]:
    """Each file's path in the repository, and its text."""
    layout = lay_out(Scenario())
    return {
        "keyspace.md": keyspace.document(),
        "orchard/config/scenario.schema.json": schema_text(),
        "docs/reference.md": reference.document(),
        "docs/scenario.md": scenario.document(),
        "docs/plan.svg": orchard_plan(layout),
        "docs/exchange-east.svg": exchange_plan(layout),
    }


if __name__ == "__main__":
    for name, text in generated().items():
        (ROOT / name).write_text(text)
        print(f"{name} written")
