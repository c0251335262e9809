"""Numbers as people type them, and as they like to read them."""

import re

WHOLE = re.compile(r"[-+]?[0-9]{1,29}")
DECIMAL = re.compile(r"[-+]?([0-9]{1,40}\.?[0-9]*|\.[0-9]+)([eE][-+]?[0-9]{1,3})?")
WITH_COMMA = re.compile(r"[-+]?[0-9]*,[0-9]+")


def number_of(text: str) -> int | float | str:
    """The number that a text is; the text itself where it is none."""
    text = text.strip()
    if WHOLE.fullmatch(text):
        return int(text)
    return float(text) if DECIMAL.fullmatch(text) else text


def shown(number: float) -> str:
    """A number as one types it, with every digit that it has."""
    return str(number).removesuffix(".0")


def hint(text: object) -> str:
    """What to do about a text that is almost a number; '' where nothing is known."""
    if isinstance(text, str) and WITH_COMMA.fullmatch(text.strip()):
        return f"; write a point: {text.strip().replace(',', '.')}"
    return ""
