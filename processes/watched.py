"""A run in this process, and whoever watches it: a recording, Rerun's window, browsers."""

import subprocess
from typing import TYPE_CHECKING, Any

from rich.console import Console

from orchard.kept import COMPILING, are_compiled
from orchard.layout import lay_out
from orchard.progress import Progress
from processes.alone import run
from processes.fleet import open_viewer
from processes.wish import Wish

if TYPE_CHECKING:
    from orchard.view import Recorder


def run_watched(wish: Wish) -> tuple[dict[str, Any], str]:
    """Harvest, and show it; the summary, and why it ended."""
    recorder, browser, viewer = _recorder(wish), _web_viewer(wish), open_viewer(wish.uri) if wish.view else None
    try:
        with Progress(Console(emoji=False, highlight=False)) as progress:
            if not are_compiled():
                progress.say(COMPILING)
            summary, why = run(wish, None if recorder is None else recorder.tick, progress.show)
        if viewer is not None and why == "stopped":
            viewer.terminate()
        return summary, why
    finally:
        if recorder is not None:
            recorder.close()
        if browser is not None:
            browser.terminate()
            browser.wait()


def _recorder(wish: Wish) -> "Recorder | None":
    """Where frames go; None where nobody wants them."""
    if wish.recording is None and not wish.is_live:
        return None
    from orchard.view import Recorder  # late: Rerun takes half a second to load

    name, port = f"{wish.scenario.rows} rows, seed {wish.scenario.seed}", wish.data_port if wish.is_live else 0
    return Recorder(lay_out(wish.scenario), name, wish.recording, serve=wish.is_live, port=port)


def _web_viewer(wish: Wish) -> subprocess.Popen[bytes] | None:
    """The process that serves browsers; None where nobody asked for it."""
    if wish.web is None:
        return None
    from orchard.view.web import page_url, serve_web

    Console(emoji=False, highlight=False).print(f"Live: {page_url(wish.web)}", soft_wrap=True)
    return serve_web(wish.web, wish.uri)
