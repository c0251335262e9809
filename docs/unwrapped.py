"""Descriptions that come from docstrings, without the line breaks of the source."""

from typing import Any


def unwrapped(part: Any) -> Any:
    """Return a JSON schema, or a part of it, with each paragraph of a description in one line."""
    if isinstance(part, dict):
        return {name: _described(name, value) for name, value in part.items()}
    if isinstance(part, list):
        return [unwrapped(item) for item in part]
    return part


def _described(name: str, value: Any) -> Any:
    """Return a value of a schema; a description without the breaks within its paragraphs."""
    if name != "description" or not isinstance(value, str):
        return unwrapped(value)
    lines: list[str] = []
    for line in value.split("\n"):
        text = line.strip() if lines else line
        # An empty line ends a paragraph, and a hyphen begins a line of a list.
        continues = bool(lines and lines[-1] and text and not text.startswith("-"))
        if continues:
            lines[-1] += f" {text}"
        else:
            lines.append(text)
    return "\n".join(lines)
