"""Elements of a page that NiceGUI does not have: headings, notes, buttons, choices,
dialogs, tables and tiles.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any
from weakref import WeakMethod

from nicegui import ui

from orchard.app.command import Latest

# Of a slider beside a field for the same number. The keyboard would stop twice, and what Quasar
# stops at has neither a name nor a role for screen readers.
NO_TAB_STOP = "tabindex=-1"


def heading(level: int, words: str = "") -> ui.label:
    """Return the text of a new heading. Screen readers go from one heading to the next."""
    with ui.element(f"h{level}"):
        return ui.label(words)


def note(props: str, classes: str = "field-problem") -> ui.label:
    """Return a label that is seen as long as it has words."""
    label = ui.label().classes(classes).props(props)
    return label.bind_visibility_from(label, "text", backward=bool)


def labelled(name: str) -> ui.element:
    """Add a field of a study with a label. Return its box."""
    with ui.element("div").classes("study-field") as box:
        ui.label(name).classes("field-label")
    return box


def button(
    words: str, act: Callable[..., Any], action: str, icon: str | None = None, props: str = "flat"
) -> ui.button:
    """Return a button whose words are not put into capitals. `action`: its name for tests."""
    return ui.button(words, icon=icon, on_click=act).props(f"{props} no-caps data-action={action}")


class StartAndStop:
    """Two buttons in one place: one starts a command, the other one stops it.

    While the command goes on, its fields are locked.
    """

    def __init__(
        self,
        commands: Latest[Any],
        fields: ui.element,
        words: str,
        start: Callable[..., Any],
        actions: tuple[str, str],
    ) -> None:
        """`fields`: is locked while a command goes on. `words`: of the button that starts one.
        `actions`: the names of both buttons for tests.
        """
        self._commands = commands
        self._fields = fields
        self._start = button(words, start, actions[0], "play_arrow", "unelevated")
        self._stop = button("Stop", commands.stop, actions[1], "stop", "unelevated color=negative")

    def name(self, words: str) -> None:
        """Give the button that starts a command other words."""
        self._start.set_text(words)

    def update(self, is_right: bool) -> None:
        """Show the button that fits. `is_right`: whether what is entered can be started."""
        going = self._commands.going
        if going is None:
            self._fields.props(remove="inert")
        else:
            self._fields.props(add="inert")
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
    choice = ui.select(names, value=chosen, multiple=True, on_change=act).classes("several")
    choice.props(f'dense outlined options-dense data-field={field} aria-label="{label}"')
    # Else the browser would take a name for HTML.
    return choice.props("display-value-html=false")


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
    """Add a table.

    `lines`: the cells of each line; the first one is its name. `head`: the names of the columns.
    `act(number)`: adds the buttons of a line, in a column of their own before the others.
    """
    with ui.element("table"):
        if head:
            names = [*head] if act is None else ["", *head]
            _head_line(names)
        for number, (name, *cells) in enumerate(lines):
            with ui.element("tr"):
                if act is not None:
                    with ui.element("td"):
                        act(number)
                with ui.element("th").props("scope=row"):
                    ui.label(name)
                for words in cells:
                    _cell(words)


def _head_line(names: Iterable[str]) -> None:
    """Add the names of columns. A column without a name gets a cell that is no heading."""
    with ui.element("tr"):
        for name in names:
            if name:
                with ui.element("th").props("scope=col"):
                    ui.label(name)
            else:
                _cell("")


def _cell(words: str) -> None:
    with ui.element("td"):
        ui.label(words)


def tiles(figures: Iterable[tuple[str, str, str]]) -> None:
    """Show figures: the name, the value, and a note on its meaning."""
    for name, value, meaning in figures:
        with ui.element("div").classes("tile").props(f"data-figure='{name}'"):
            ui.label(name).classes("tile-name")
            ui.label(value).classes("tile-value")
            ui.label(meaning).classes("tile-note")


def mark_wrong(element: ui.element, is_wrong: bool) -> None:
    """Show whether something is wrong at an element, by its colours."""
    if is_wrong:
        element.classes(add="wrong")
    else:
        element.classes(remove="wrong")


def while_alive(method: Callable[..., Any]) -> Callable[..., Any]:
    """Return a function that calls a bound method as long as the method's object is there.

    Afterwards it does nothing. FastAPI keeps the routes of uploads of deleted pages, some thousand
    of them. Each refers to its handler, and a bound method would keep its whole page.
    """
    reference = WeakMethod(method)

    # NiceGUI gives the event only to a handler with a parameter of its own, and not to
    # `*arguments`.
    def call(event: Any) -> Any:
        living_method = reference()
        if living_method is None:
            return None
        return living_method(event)

    return call
