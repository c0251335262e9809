"""Writes every file that is generated from the code: keyspace.md, the scenario's JSON schema, and the drawings in docs/."""

from pathlib import Path

from docs.keyspace import document
from orchard.field.layout import lay_out
from orchard.field.scenario import Scenario, schema_text
from orchard.report.plan import exchange_plan, orchard_plan

ROOT = Path(__file__).parent.parent


def generated() -> dict[str, str]:
    """Each file's path in the repository, and its text."""
    layout = lay_out(Scenario())
    return {
        "keyspace.md": document(),
        "config/scenario.schema.json": schema_text(),
        "docs/plan.svg": orchard_plan(layout),
        "docs/exchange-east.svg": exchange_plan(layout),
    }


if __name__ == "__main__":
    for name, text in generated().items():
        (ROOT / name).write_text(text)
        print(f"{name} written")
