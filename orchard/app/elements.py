"""Elements of a page that NiceGUI does not have: headings, words that come and go, dialogs,
tables.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any
from weakref import WeakMethod

from nicegui import ui

from orchard.app.command import Latest


def heading(level: int, words: str = "") -> ui.label:
    """Return the text of a new heading. Screen readers go from one heading to the next."""
    with ui.element(f"h{level}"):
        return ui.label(words)


def note(props: str, classes: str = "field-problem") -> ui.label:
    """Return a label that is seen as long as it has words."""
    label = ui.label().classes(classes).props(props)
    return label.bind_visibility_from(label, "text", backward=bool)


def button(
    words: str, act: Callable[..., Any], action: str, icon: str | None = None, props: str = "flat"
) -> ui.button:
    """Return a button with its words as they are. `action`: its name for tests."""
    return ui.button(words, icon=icon, on_click=act).props(f"{props} no-caps data-action={action}")


class StartAndStop:
    """Two buttons in one place: one starts a command; while it goes on, its fields are locked, and
    the other one stops it.
    """

    def __init__(
        self,
        commands: Latest[Any],
        fields: ui.element,
        words: str,
        start: Callable[..., Any],
        actions: tuple[str, str],
    ) -> None:
        self._commands, self._fields = commands, fields
        self._start = button(words, start, actions[0], "play_arrow", "unelevated")
        self._stop = button("Stop", commands.stop, actions[1], "stop", "unelevated color=negative")

    def update(self, is_right: bool) -> None:
        """Show the button that fits. `is_right`: whether what is entered can be started."""
        going = self._commands.going
        self._fields.props(add="inert" if going else "", remove="" if going else "inert")
        self._start.set_visibility(going is None)
        self._start.set_enabled(is_right)
        self._stop.set_visibility(going is not None)
        self._stop.set_enabled(going is not None and not going.asked_to_stop)


def several(
    names: list[str],
    chosen: list[str],
    field: str,
    label: str,
    act: Callable[..., Any] | None = None,
) -> ui.select:
    """Return a choice of any number of names. `field`: its name for tests."""
    some = ui.select(names, value=chosen, multiple=True, on_change=act).classes("several")
    return some.props(
        f"dense outlined options-dense display-value-html=false data-field={field}"
        f' aria-label="{label}"'
    )


@contextmanager
def dialog(title: str, lines: Iterable[str] = (), view: str = "complaint") -> Iterator[ui.dialog]:
    """Open a dialog with a title and lines, to which more can be added.

    `view`: its name for tests.
    """
    with ui.dialog(value=True) as opened, ui.card().classes("complaint").props(f"data-view={view}"):
        opened.props["aria-label"] = title
        heading(2, title).classes("group-title")
        for line in lines:
            ui.label(line).classes("complaint-line")
        yield opened


def table(
    lines: Iterable[Sequence[str]],
    head: Sequence[str] = (),
    act: Callable[[int], Any] | None = None,
) -> None:
    """Add a table: lines whose first cells are names, under a head.

    `act(number)` adds buttons to a line.
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


def tiles(figures: Iterable[tuple[str, str, str]]) -> None:
    """Show figures: the name, the value, and a note on its meaning."""
    for name, value, meaning in figures:
        with ui.element("div").classes("tile").props(f"data-figure='{name}'"):
            ui.label(name).classes("tile-name")
            ui.label(value).classes("tile-value")
            ui.label(meaning).classes("tile-note")


def while_alive(method: Callable[..., Any]) -> Callable[..., Any]:
    """Return a function that calls a bound method, and does nothing once the method's object is
    gone.

    FastAPI remembers some thousand upload routes after their pages were deleted. Through its
    handler of files, such a route would keep all elements of its page.
    """
    kept = WeakMethod(method)

    # NiceGUI gives the event only to a handler with a parameter of its own, and not to
    # `*arguments`.
    def call(event: Any) -> Any:
        living = kept()
        return None if living is None else living(event)

    return call
