"""Buttons that open and save scenarios and load presets."""

from collections.abc import Callable

from nicegui import events, ui

from orchard.app.run_controls import ROOT
from orchard.field.problems import ScenarioError
from orchard.field.scenario import LARGEST_FILE, Scenario, load, parse, to_yaml

Take = Callable[[Scenario], None]


def presets() -> dict[str, Scenario]:
    """Return the presets by name: the default scenario, and each file in `config/` except orchard.yaml, which holds the default."""
    ready = {path.stem: load(path) for path in sorted((ROOT / "config").glob("*.yaml")) if path.stem != "orchard"}
    return {"default": Scenario()} | ready


class FileButtons:
    """Buttons for the presets, Open and Save."""

    def __init__(self, take: Take, current: Callable[[], Scenario | None]) -> None:
        self._take, self._current = take, current
        for name, scenario in presets().items():
            ui.button(name.capitalize(), on_click=lambda scenario=scenario: take(scenario)).props(f"flat no-caps data-preset={name}")
        ui.element("div").classes("divider")
        limit = 10 * LARGEST_FILE  # bytes; a larger file is not read, `parse` reports a smaller one above LARGEST_FILE
        self._upload = ui.upload(on_upload=self._open, on_rejected=self._rejected, max_file_size=limit, auto_upload=True)
        self._upload.props("accept=.yaml,.yml").classes("hidden")
        ui.button("Open", icon="folder_open", on_click=lambda: self._upload.run_method("pickFiles")).props("flat no-caps data-action=open")
        self._save = ui.button("Save", icon="download", on_click=self._download).props("flat no-caps data-action=save")

    def allow_saving(self, allowed: bool) -> None:
        """Enable or disable Save."""
        self._save.set_enabled(allowed)

    async def _open(self, event: events.UploadEventArguments) -> None:
        content = await event.file.read()
        self._upload.reset()
        try:
            self._take(parse(content.decode("utf-8-sig"), event.file.name))
        except UnicodeDecodeError:
            complain("This file was not opened", [f"{event.file.name}: not UTF-8 text"])
        except ScenarioError as error:
            complain("This file was not opened", [str(problem) for problem in error.problems])
        else:
            ui.notify(f"{event.file.name} opened", type="positive")

    def _rejected(self) -> None:
        complain("This file was not opened", ["The file is too large for a scenario, or it is not a .yaml file."])

    def _download(self) -> None:
        if (scenario := self._current()) is not None:
            ui.download.content(to_yaml(scenario), "orchard.yaml", "application/yaml")


def complain(title: str, lines: list[str]) -> None:
    """Open a dialog with a title and error lines. Nothing else changes."""
    with ui.dialog(value=True) as dialog, ui.card().classes("complaint").props("data-view=complaint"):
        ui.label(title).classes("group-title")
        for line in lines:
            ui.label(line).classes("complaint-line")
        ui.button("OK", on_click=dialog.close).props("no-caps unelevated").classes("self-end")
