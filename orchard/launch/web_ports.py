"""The ports with which a run or a recording is shown in a browser."""

from orchard.net.endpoints import check_free
from orchard.terminal.open_files import allow_files

# Files that this program may have open at once while it serves a viewer. When that was measured 32
# were enough; the rest is a reserve.
VIEWER_FILES = 48


def check_ports(port: int) -> None:
    """Check that the web viewer can have its port, the next one for its data, and its files.

    Raises BusError for a port, ValueError for the number of files.
    """
    allow_files(VIEWER_FILES, "a viewer in a browser needs")
    for number in (port, port + 1):
        check_free(f"tcp/127.0.0.1:{number}")
