"""The users' own classes that a scenario names: they come with a file, and drive in place of ours."""

from collections.abc import Callable

from nicegui import ui

from orchard.app.draft import CLASSES, Draft


class ClassesView:
    """Which they are, and what is wrong with them; nothing is seen where there are none."""

    def __init__(self, drop: Callable[[], None]) -> None:
        with ui.element("section").classes("group") as self._box:
            ui.label("Own classes").classes("group-title")
            self._names = ui.label().classes("classes").props("data-view=classes")
            self._problem = ui.label().classes("field-problem").props(f"data-problem={CLASSES} role=alert")
            ui.button("Drive with the built-in ones", on_click=drop).props("flat dense no-caps data-action=drop-classes")
        self._box.set_visibility(False)

    def show(self, draft: Draft) -> None:
        self._box.set_visibility(bool(draft.classes))
        self._names.set_text("\n".join(f"{word}: {path}" for word, path in draft.classes.items()))
        problems = [words for path, words in draft.problems.items() if path.split(".")[0] == CLASSES]
        self._problem.set_text("\n".join(problems))
        self._problem.set_visibility(bool(problems))
