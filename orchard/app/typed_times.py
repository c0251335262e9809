"""Times of day and breaks as a user types them: "7:00", and "10:00-10:15, 12:00-12:45"."""

import re

TIME = re.compile(r"([0-9]{1,2}):([0-9]{2})")
# Some write a dash in place of the hyphen.
BREAK = re.compile(r"([0-9:]{4,5}) *[-\u2013] *([0-9:]{4,5})")


def time_of(text: str) -> str:
    """Return a time of day with two digits for the hour, or the text, stripped, if it is none.

    >>> time_of("7:00"), time_of("half past six")
    ('07:00', 'half past six')
    """
    text = text.strip()
    match = TIME.fullmatch(text)
    if match is None:
        return text
    return f"{match[1]:0>2}:{match[2]}"


def breaks_of(text: str) -> tuple[tuple[str, str], ...] | str:
    """Return the begin and end of each break, or the text, stripped, if it is something else.

    No text means no breaks.

    >>> breaks_of("10:00-10:15, 12:00 - 12:45"), breaks_of("at noon")
    ((('10:00', '10:15'), ('12:00', '12:45')), 'at noon')
    """
    text = text.strip()
    if not text:
        return ()
    breaks = []
    for part in text.split(","):
        match = BREAK.fullmatch(part.strip())
        if match is None:
            return text
        breaks.append((time_of(match[1]), time_of(match[2])))
    return tuple(breaks)


def breaks_shown(breaks: object) -> str:
    """Return breaks as a user types them. A text stays as it is.

    >>> breaks_shown((("10:00", "10:15"), ("12:00", "12:45")))
    '10:00-10:15, 12:00-12:45'
    """
    if isinstance(breaks, str):
        return breaks
    if not isinstance(breaks, list | tuple):
        return ""
    return ", ".join("-".join(pair) for pair in breaks)
