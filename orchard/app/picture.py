"""Rerun's viewer of a run: its servers, for the live run and later for its recording."""

import subprocess

from nicegui import ui

from orchard.app.command import Files
from orchard.field.layout import lay_out
from orchard.field.scenario import Scenario
from orchard.view.blueprint import for_page
from orchard.view.files import parts_of
from orchard.view.web import address, data_uri, free_pair, is_open, page_url, serve_web

# Between two looks whether servers answer.
LOOK_SECONDS = 0.3


class ViewerPanel:
    """The picture of a run. `port`: of the viewer; that of live data is the next one."""

    def __init__(self, scenario: Scenario, files: Files) -> None:
        """Write the views of a scenario to their file, and serve them. Raises OSError."""
        self.port = free_pair()
        self._views_port = free_pair()
        self._files = files
        # What the viewer loads: live data, and later the recording.
        self._source = data_uri(self.port)
        for_page(lay_out(scenario)).save("orchard", files.views)
        views = serve_web(self._views_port, str(files.views))
        self._servers: list[subprocess.Popen[bytes]] = [views]

    def play(self) -> None:
        """Serve the recording from now on."""
        recording = self._files.recording
        self._source = str(recording)
        self._servers.append(serve_web(self.port, *map(str, parts_of(recording))))

    @property
    def address(self) -> str:
        """The address of the picture, live or recorded; '' while its servers do not answer."""
        ports = self.port, self.port + 1, self._views_port + 1
        if not all(map(is_open, ports)):
            return ""
        views = address(self._views_port, str(self._files.views))
        return page_url(self.port, self._source, views)

    def close(self) -> None:
        """End the servers."""
        for server in self._servers:
            with server:
                server.terminate()


class IFrame(ui.element):
    """A frame for a picture, empty until it has an address."""

    def __init__(self, title: str) -> None:
        """`title`: for screen readers."""
        super().__init__("iframe")
        self.classes("picture").props(f'data-view=picture allow=fullscreen title="{title}"')


class Player(IFrame):
    """A frame that plays a recording as soon as its servers answer. They end with the frame."""

    def __init__(self, scenario: Scenario, files: Files, title: str) -> None:
        """`title`: for screen readers. Raises OSError."""
        super().__init__(title)
        self._picture = ViewerPanel(scenario, files)
        self._picture.play()
        self._timer = ui.timer(LOOK_SECONDS, self._point)

    def _point(self) -> None:
        """Show the recording, if its servers answer."""
        url = self._picture.address
        if url:
            self.props(f'src="{url}"')
            self._timer.cancel()

    def _handle_delete(self) -> None:
        self._picture.close()
        super()._handle_delete()
