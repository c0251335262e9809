"""The JSON schema of a scenario, for editors. It stands in config/scenario.schema.json."""

import json

from docs.unwrapped import unwrapped
from orchard.field.scenario import Scenario


def schema_text() -> str:
    """Return the text of `config/scenario.schema.json`.

    It does not contain the rules that compare several fields.
    """
    schema = {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        **Scenario.model_json_schema(),
    }
    return json.dumps(unwrapped(schema), indent=2) + "\n"
