"""A field for a text that both the user and the program write.

Messages to the browser and back take their time, and so a text of the program may come to a field
in which the user has typed meanwhile. The browser counts how often the user has typed, and the
program sends the last count that it knows with each text. The browser drops a text that comes with
an older count: it was sent before what the user has typed, which the program still gets. So a field
always ends with the text that the program has.

`ui.input` of NiceGUI shows such a text, and may send it back as if the user had typed it.
"""

from collections.abc import Callable

from nicegui import ui
from nicegui.events import GenericEventArguments


class TypedField(ui.element, component="typed_field.js"):
    """A field for a text. `value`: what was written last, by the user or by the program."""

    def __init__(self, on_change: Callable[[], None] = lambda: None) -> None:
        """`on_change`: is called after each change, also after one of the program."""
        super().__init__()
        self.value = ""
        self._on_change = on_change
        self._props["written"] = ""
        self._props["writings"] = 0
        self._props["heard"] = 0
        self.on("typed", self._typed)

    def set_value(self, text: str) -> None:
        """Write a text into the field."""
        if text == self.value:
            return
        self.value = text
        self._props["written"] = text
        self._props["writings"] += 1
        self.update()
        self._on_change()

    def _typed(self, event: GenericEventArguments) -> None:
        """Take what the user has typed.

        While a connection is made anew, an older text may come after a newer one.
        """
        text, typings = event.args
        if typings <= self._props["heard"]:
            return
        with self._props.suspend_updates():
            self._props["heard"] = typings
        if text != self.value:
            self.value = text
            self._on_change()
