"""Writes every file that is generated: keyspace.md, docs/reference.md, docs/api.md, docs/study.md,
the JSON schema, and drawings.

All follow from the code, those of the study from docs/study.json, docs/policies.svg from the tables
of docs/bounds.md, and what docs/benchmark.md measures from docs/benchmark.json.
`python -m docs.study` and `python -m docs.validation` measure anew.
"""

from pathlib import Path

from docs import api, benchmark, keyspace, policies, reference, study, validation
from docs.exchange import exchange_plan
from docs.scenario_schema import schema_text
from orchard.field.layout import lay_out
from orchard.field.queue import ONE_WAY
from orchard.field.scenario import Scenario
from orchard.report.plan import orchard_plan

ROOT = Path(__file__).parent.parent


def generated() -> dict[str, str]:
    """Return the text of each file, by its path in the repository."""
    one_way = lay_out(Scenario(route=ONE_WAY))
    two_way = lay_out(Scenario(carriers=10))
    return {
        "keyspace.md": keyspace.keyspace(),
        "docs/protocol.md": keyspace.protocol(),
        "docs/messages.md": keyspace.messages(),
        "config/scenario.schema.json": schema_text(),
        "docs/api.md": api.document(),
        "docs/reference.md": reference.document(),
        "docs/study.md": study.document(),
        "docs/study.svg": study.picture(),
        "docs/benchmark.md": benchmark.document(),
        "docs/benchmark.svg": benchmark.picture(),
        "docs/learning.svg": benchmark.learning_picture(),
        "docs/policies.svg": policies.picture(),
        "docs/validation.md": validation.document(),
        **validation.pictures(),
        "docs/plan.svg": orchard_plan(one_way),
        "docs/exchange-east.svg": exchange_plan(one_way),
        "docs/plan-two-way.svg": orchard_plan(two_way),
        "docs/exchange-east-two-way.svg": exchange_plan(two_way),
    }


def generated_and_ignored() -> dict[str, str]:
    """Return the text of each file that git ignores, by its path.

    It is for programs. Tests check the text, so they need no file.
    """
    return {"docs/asyncapi.json": keyspace.asyncapi()}


if __name__ == "__main__":
    for name, text in (generated() | generated_and_ignored()).items():
        (ROOT / name).write_text(text)
        print(f"{name} written")
