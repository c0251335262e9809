"""Numbers as a user types them: what a text means, and what is wrong with it.

A point or a comma is the decimal sign: 4.5 and 4,5 are the same. A comma before three digits may
also part thousands. So 1,250 is refused with both of its meanings, and 0,125 is not.
"""

import re
from collections.abc import Sequence

# Digits that are read. More of them are refused before Python would take long to read them.
WHOLE = re.compile(r"[-+]?[0-9]{1,29}")
DECIMAL = re.compile(r"[-+]?([0-9]{1,40}[.,]?[0-9]*|[.,][0-9]+)([eE][-+]?[0-9]{1,3})?")
# The comma of such a number may be a decimal sign, or part thousands.
AMBIGUOUS = re.compile(r"[-+]?[1-9][0-9]{0,2},[0-9]{3}")
# A time with its unit, and how many seconds a unit has.
TIME = re.compile(r"(.*[0-9.,]) *(s|min|h)")
SECONDS = {"s": 1, "min": 60, "h": 3600}


def number_of(text: str) -> int | float | str:
    """Return the number in a text, or the text, stripped, if it is not a number.

    >>> number_of("4.5"), number_of("4,5"), number_of("1,250")
    (4.5, 4.5, '1,250')
    """
    text = text.strip()
    if WHOLE.fullmatch(text):
        return int(text)
    if DECIMAL.fullmatch(text) and not AMBIGUOUS.fullmatch(text):
        return float(text.replace(",", "."))
    return text


def shown(number: float) -> str:
    """Return a number as a user types it, with all its digits."""
    return str(number).removesuffix(".0")


def with_point(text: str) -> str:
    """Return a number that was typed as a command takes it: 0.5 for 0,5. A text stays as it is.

    >>> with_point(" 0,5 ")
    '0.5'
    """
    number = number_of(text)
    if isinstance(number, str):
        return number
    return shown(number)


def in_seconds(text: str) -> str:
    """Return a time with a unit as the number of its seconds. Any other text stays as it is.

    >>> in_seconds("7,5 h"), in_seconds("600"), in_seconds("noon")
    ('27000', '600', 'noon')
    """
    match = TIME.fullmatch(text.strip())
    if match is None:
        return text
    number = number_of(match[1])
    if isinstance(number, str):
        return text
    return shown(number * SECONDS[match[2]])


def meanings_of(text: object) -> list[str]:
    """Return both numbers that an ambiguous text may mean, as text; nothing for all else.

    >>> meanings_of("1,250")
    ['1.25', '1250']
    """
    if not isinstance(text, str) or not AMBIGUOUS.fullmatch(text.strip()):
        return []
    decimal = float(text.strip().replace(",", "."))
    whole = int(text.strip().replace(",", ""))
    return [shown(decimal), shown(whole)]


def advice_on(text: object, accepted: Sequence[str]) -> str:
    """Return advice to append to an error message about an ambiguous number; '' for all else.

    `accepted`: those of its meanings that are right. Only these may be advised.
    """
    if not accepted:
        return ""
    return f"; {text} may mean {' or '.join(meanings_of(text))}: write {' or '.join(accepted)}"


def span(limits: tuple[float, float]) -> str:
    """Return limits as text: 0.1 to 1000."""
    return f"{limits[0]:g} to {limits[1]:.0f}"


def number_problem(text: str, limits: tuple[float, float], also: str = "") -> str:
    """Return what is wrong with a text; '' if it is a number within the limits.

    `limits`: both are included. `also`: words that the problem ends with.
    """
    if _is_within(text, limits):
        return ""
    accepted = [meaning for meaning in meanings_of(text) if _is_within(meaning, limits)]
    return f"must be a number from {span(limits)}{also}{advice_on(text, accepted)}"


def _is_within(text: str, limits: tuple[float, float]) -> bool:
    number = number_of(text)
    return not isinstance(number, str) and limits[0] <= number <= limits[1]
