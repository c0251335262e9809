"""The command `orchard app`: serves the page."""

import signal
from pathlib import Path
from typing import Annotated

from typer import Option

from orchard.folders import runs_folder
from orchard.terminal.exits import exit_on_errors, needs_extra
from orchard.terminal.open_files import allow_files

# Files that this program may have open at once while it serves the page: 32 are enough at its
# begin; each run and each browser needs some.
PAGE_FILES = 128

_HOST = "Any client that reaches it can start runs; 0.0.0.0: under this machine's name."
_FOLDER = "Folder of recordings and summaries. Default: that of all runs."
Port = Annotated[int, Option(min=0, max=65535, metavar="PORT", help="Port of the page.")]
Host = Annotated[str, Option(metavar="ADDRESS", help=_HOST)]
Folder = Annotated[Path | None, Option("--runs", metavar="DIR", help=_FOLDER)]
Quiet = Annotated[bool, Option("--quiet", metavar="", help="Do not open a browser.")]


def app(
    port: Port = 8080, host: Host = "127.0.0.1", runs: Folder = None, quiet: Quiet = False
) -> None:
    """Set up an orchard in the browser, run it, and watch it."""
    # Ctrl-C during the imports ends the process silently.
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    with needs_extra("The page", "app"):
        from orchard.app.serve import serve
    with exit_on_errors(ValueError):
        allow_files(PAGE_FILES, "the page needs")
        serve(host, port, runs or runs_folder(), not quiet)
