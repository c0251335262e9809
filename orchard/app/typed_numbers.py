"""Numbers as a user types them: what a text means, and what is wrong with it."""

import re

# Digits that are read. More of them are refused before Python would take long to read them.
WHOLE = re.compile(r"[-+]?[0-9]{1,29}")
DECIMAL = re.compile(r"[-+]?([0-9]{1,40}\.?[0-9]*|\.[0-9]+)([eE][-+]?[0-9]{1,3})?")
WITH_COMMA = re.compile(r"[-+]?[0-9]*,[0-9]+")


def number_of(text: str) -> int | float | str:
    """Return the number in a text, or the text, stripped, if it is not a number."""
    text = text.strip()
    if WHOLE.fullmatch(text):
        return int(text)
    if DECIMAL.fullmatch(text):
        return float(text)
    return text


def shown(number: float) -> str:
    """Return a number as a user types it, with all its digits."""
    return str(number).removesuffix(".0")


def with_point(text: object) -> str:
    """Return a number that was typed with a comma as it is typed with a point; '' for all else."""
    if not isinstance(text, str) or not WITH_COMMA.fullmatch(text.strip()):
        return ""
    return text.strip().replace(",", ".")


def write_a_point(number: str) -> str:
    """Return advice to append to an error message.

    Only a number that is accepted may be advised.
    """
    return f"; write a point: {number}"


def span(limits: tuple[float, float]) -> str:
    """Return limits as text: 0.1 to 1000."""
    return f"{limits[0]:g} to {limits[1]:.0f}"


def number_problem(text: str, limits: tuple[float, float], also: str = "") -> str:
    """Return what is wrong with a text; '' if it is a number within the limits.

    `limits`: both are included. `also`: words that the problem ends with.
    """
    if _is_within(text, limits):
        return ""
    problem = f"must be a number from {span(limits)}{also}"
    meant = with_point(text)
    if _is_within(meant, limits):
        problem += write_a_point(meant)
    return problem


def _is_within(text: str, limits: tuple[float, float]) -> bool:
    number = number_of(text)
    return not isinstance(number, str) and limits[0] <= number <= limits[1]
