"""Elements of a page that NiceGUI does not have: headings, and a plain table."""

from collections.abc import Iterable, Sequence

from nicegui import ui


def heading(level: int, words: str = "") -> ui.label:
    """Return the text of a new heading. Screen readers go from one heading to the next."""
    with ui.element(f"h{level}"):
        return ui.label(words)


def table(lines: Iterable[Sequence[str]], head: Sequence[str] = ()) -> None:
    """Add a table. The first cell of each line is the line's name; `head`: the names of the columns, '' above those of the lines."""
    with ui.element("table"):
        if head:
            with ui.element("tr"):
                for name in head:
                    _cell("th" if name else "td", name, "scope=col")
        for name, *cells in lines:
            with ui.element("tr"):
                _cell("th", name, "scope=row")
                for words in cells:
                    _cell("td", words)


def _cell(tag: str, words: str, props: str = "") -> None:
    with ui.element(tag).props(props if tag == "th" else ""):
        ui.label(words)
