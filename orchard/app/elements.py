"""Elements of a page that NiceGUI does not have: headings, and a plain table."""

from collections.abc import Callable, Iterable, Sequence
from typing import Any

from nicegui import ui


def heading(level: int, words: str = "") -> ui.label:
    """Return the text of a new heading. Screen readers go from one heading to the next."""
    with ui.element(f"h{level}"):
        return ui.label(words)


def table(lines: Iterable[Sequence[str]], head: Sequence[str] = (), act: Callable[[int], Any] | None = None) -> None:
    """Add a table. The first cell of each line is the line's name. `head`: the names of the columns; the first one may be ''.

    `act(number)` adds buttons for a line, in a cell before its name.
    """
    with ui.element("table"):
        if head:
            with ui.element("tr"):
                for name in [*([""] if act else []), *head]:
                    _cell("th" if name else "td", name, "scope=col")
        for number, (name, *cells) in enumerate(lines):
            with ui.element("tr"):
                if act is not None:
                    with ui.element("td"):
                        act(number)
                _cell("th", name, "scope=row")
                for words in cells:
                    _cell("td", words)


def _cell(tag: str, words: str, props: str = "") -> None:
    with ui.element(tag).props(props if tag == "th" else ""):
        ui.label(words)
