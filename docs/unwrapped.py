"""Descriptions that come from docstrings, without the line breaks of the source."""

import re
from typing import Any


def unwrapped(part: Any) -> Any:
    """Return a JSON schema, or a part of one, with each paragraph of its descriptions in
    one line.
    """
    if isinstance(part, dict):
        return {name: _described(name, value) for name, value in part.items()}
    if isinstance(part, list):
        return [unwrapped(one) for one in part]
    return part


def _described(name: str, value: Any) -> Any:
    if name == "description" and isinstance(value, str):
        return re.sub(r"(?<!\n)\n[ ]*(?![\n -])", " ", re.sub(r"\n[ ]+(?=[^ \n-])", "\n", value))
    return unwrapped(value)
