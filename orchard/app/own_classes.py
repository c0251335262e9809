"""The user's own classes that a scenario names.

The page takes them from one folder, and asks first.
"""

import sys
from importlib.machinery import PathFinder
from pathlib import Path

from nicegui import ui

from orchard.app.elements import button, dialog
from orchard.field.scenario import Scenario

# Keys of a scenario that hold maps of classes. A file names them; they are not entered on the page.
AGENTS = ("agents", "agents_without_body")
# A key of a scenario that names a rule -> the built-in rules, which the page offers.
CHOICES: dict[str, list[str]] = {
    name: [*map(str, field.examples)]
    for name, field in Scenario.model_fields.items()
    if field.examples
}


def from_elsewhere(classes: dict[str, str], folder: Path) -> list[str]:
    """Return a sentence for each class that is not from a module in this folder.

    `classes`: key of the scenario -> dotted path of the class. No module is run.
    """
    sentences = []
    for key, path in classes.items():
        if not _is_in(path, folder):
            sentences.append(f"{key}: {path} is not in {folder}, where this page was started")
    return sentences


def _is_in(path: str, folder: Path) -> bool:
    """Whether Python finds the module of a class in this folder itself.

    A module in a folder below, such as a package that is installed in .venv, does not count if that
    folder is itself on Python's path. The module is not run.

    `path`: of a class, as `module:Class` or `module.Class`.
    """
    module = path.partition(":")[0] if ":" in path else path.rpartition(".")[0]
    parts = module.split(".")
    # `orchard.field.plugins`, which imports the class, looks in the folder after all else.
    first = PathFinder.find_spec(parts[0], [*sys.path, str(folder)])
    if first is None:
        return False
    package_folders = first.submodule_search_locations
    if package_folders is None:
        location = Path(first.origin or "")
    else:
        package_folder, *_ = package_folders
        location = Path(package_folder)
    inside = folder.joinpath(*parts)
    is_module = inside.with_name(f"{inside.name}.py").is_file()
    is_package = (inside / "__init__.py").is_file()
    return location.parent == folder and (is_module or is_package)


async def may_run(classes: dict[str, str], file: str) -> bool:
    """Ask whether the classes that a file names may run here. Return the answer.

    A dialog that is closed without an answer refuses.
    """
    warning = (
        "It names these classes. They can do whatever you can: read, change and send your files."
        " Do you trust them?"
    )
    names = [f"{key}: {path}" for key, path in classes.items()]
    with (
        dialog(f"{file} runs code on this computer", [warning, *names], "question") as question,
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
