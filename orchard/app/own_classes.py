"""The user's own classes that a scenario names: the page takes them from one folder, and asks
first.
"""

import sys
from importlib.machinery import PathFinder
from pathlib import Path

from nicegui import ui

from orchard.app.elements import button, dialog
from orchard.field.scenario import Scenario

AGENTS = (
    "agents",
    "agents_without_body",
)  # maps of classes, named in a file, not entered on the page
CHOICES: dict[
    str, list[str]
] = {  # a key that names a rule -> the built-in ones, which the page offers
    name: [*map(str, field.examples)]
    for name, field in Scenario.model_fields.items()
    if field.examples
}


def from_elsewhere(classes: dict[str, str], folder: Path) -> list[str]:
    """Say which of these classes are not from a module in this directory. No module is run."""
    return [
        f"{key}: {path} is not in {folder}, where this page was started"
        for key, path in classes.items()
        if not _is_in(path, folder)
    ]


def _is_in(path: str, folder: Path) -> bool:
    """Whether Python finds a module in this folder, not in one inside, as .venv may be.

    It is not run.
    """
    module, _, _ = path.partition(":") if ":" in path else path.rpartition(".")
    parts = module.split(".")
    # An import looks there too, after all else: `orchard.field.plugins`.
    first = PathFinder.find_spec(parts[0], [*sys.path, str(folder)])
    if first is None:
        return False
    places = first.submodule_search_locations  # None: it is no package
    found = Path(first.origin or "") if places is None else Path(next(iter(places)))
    inside = folder.joinpath(*parts)
    return found.parent == folder and (
        inside.with_name(f"{inside.name}.py").is_file() or (inside / "__init__.py").is_file()
    )


async def may_run(classes: dict[str, str], file: str) -> bool:
    warning = (
        "It names these classes. They can do whatever you can: read, change and send your files. Do"
        " you trust them?"
    )
    named = [f"{key}: {path}" for key, path in classes.items()]
    with (
        dialog(f"{file} runs code on this computer", [warning, *named], "question") as question,
        ui.row().classes("self-end"),
    ):
        button("Do not open", lambda: question.submit(False), "refuse-classes")
        button(
            "Open and let them run",
            lambda: question.submit(True),
            "trust-classes",
            props="unelevated",
        )
    return bool(await question)
