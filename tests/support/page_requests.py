"""Serve the page, ask for it often without a browser, and print what of it is still in memory.

Usage: python page_requests.py PORT REQUESTS FOLDER
"""

import gc
import json
import os
import signal
import sys
import threading
import time
import urllib.request
from pathlib import Path

from nicegui import Client
from nicegui.element import Element
from patience import PATIENCE

from orchard.app.page import Page
from orchard.app.serve import serve
from orchard.app.unseen import MOST


def ask(address: str, requests: int) -> None:
    """Ask for the page as a program does that runs no scripts. Then end this process."""
    try:
        _ask_first(address)
        for _ in range(requests - 1):
            urllib.request.urlopen(address, timeout=PATIENCE).close()
        print(json.dumps(_in_memory()))
    finally:
        os.kill(os.getpid(), signal.SIGINT)


def _ask_first(address: str) -> None:
    deadline = time.monotonic() + PATIENCE
    while True:
        try:
            urllib.request.urlopen(address, timeout=PATIENCE).close()
            return
        except OSError:
            if time.monotonic() > deadline:
                raise
            time.sleep(0.1)


def _in_memory() -> dict[str, int]:
    """Return the counts of pages and of deleted elements.

    Tasks of deleted pages are given time to end.
    """
    deadline = time.monotonic() + PATIENCE
    while True:
        gc.collect()
        pages = [known for known in gc.get_objects() if type(known) is Page]
        if len(pages) <= MOST or time.monotonic() > deadline:
            break
        del pages
        time.sleep(0.1)
    deleted = [
        known for known in gc.get_objects() if issubclass(type(known), Element) and known.is_deleted
    ]
    return {"pages": len(pages), "deleted elements": len(deleted)}


if __name__ == "__main__":
    # NiceGUI deletes a page without a browser after a minute: this is not what is tested.
    Client.prune_instances = lambda **_: None
    port, requests, folder = sys.argv[1:]
    asking = (f"http://127.0.0.1:{port}/", int(requests))
    threading.Thread(target=ask, args=asking, daemon=True).start()
    serve("127.0.0.1", int(port), Path(folder), False)
