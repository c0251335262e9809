"""A harvest from the page: the command `orchard` that does it, what it says, and its picture."""

import contextlib
from typing import Any

import msgspec

from orchard.app.command import Files, PageCommand
from orchard.app.course import Course, course_of
from orchard.app.latest import Latest
from orchard.app.past import Record
from orchard.app.run_controls import RunSettings, command
from orchard.field.layout import lay_out
from orchard.field.scenario import Scenario
from orchard.report.history import NAMES
from orchard.report.progress import Headline
from orchard.view.blueprint import for_page
from orchard.view.files import parts_of
from orchard.view.web import address, data_uri, free_pair, is_open, page_url, serve_web


class Run(PageCommand):
    """One run."""

    def __init__(self, scenario: Scenario, settings: RunSettings, files: Files) -> None:
        self.settings = settings
        self.port, self.views_port = free_pair(), free_pair()
        self._shown = [data_uri(self.port)]  # what the picture shows: the live run, and later the parts of its recording
        self.headline: Headline | None = None
        self.summary: dict[str, Any] | None = None
        self._course: dict[str, list[float]] = {name: [] for name in NAMES}  # what the lines of progress say
        for_page(lay_out(scenario)).save("orchard", files.views)
        self._servers = [serve_web(self.views_port, str(files.views))]  # of the views, and later of the recording
        super().__init__(scenario, files, command(settings, files, self.port))

    def words_of(self, line: str) -> str | None:
        """Take the progress that a line tells."""
        words = super().words_of(line)
        with contextlib.suppress(ValueError, KeyError, RecursionError):  # any other line
            self.headline = msgspec.json.decode(line, type=dict[str, Headline])["progress"]
            words, self.has_begun = str(self.headline), True
            self._add_to_course(self.headline)
        return words

    def _add_to_course(self, now: Headline) -> None:
        busy = now.carrier_utilisation * now.sim_seconds * self.scenario.carrier_count
        sample = now.sim_seconds, now.bins_delivered, now.pickers_waited_seconds, busy
        for name, value in zip(NAMES, sample, strict=True):
            self._course[name].append(value)

    def finish(self) -> None:
        """Read the summary and serve the recording. Both are ready before the run is over."""
        if (record := self.read(self.files.summary, Record)) is not None:
            self.headline, self.summary = record, self.read(self.files.summary, dict[str, Any])
        if self.files.recording.exists():
            self._shown = list(map(str, parts_of(self.files.recording)))
            self._servers.append(serve_web(self.port, *self._shown))

    @property
    def picture(self) -> str:
        """The address of the picture, live or recorded; '' while its servers do not answer."""
        ports = self.port, self.port + 1, self.views_port + 1
        views = address(self.views_port, str(self.files.views))
        return page_url(self.port, *self._shown, views) if all(map(is_open, ports)) else ""

    @property
    def course(self) -> Course:
        """The course of the run as far as it is known."""
        known = self._course if self.summary is None else self.summary["history"]
        return course_of({name: list(values) for name, values in known.items()}, self.scenario)

    @property
    def is_complete(self) -> bool:
        """Whether the run came to its end, and there is a summary."""
        return self.summary is not None and bool(self.summary["finished"] or not self.asked_to_stop)

    def close(self) -> None:
        """End the run and the servers of its picture."""
        super().close()
        for server in self._servers:
            with server:
                server.terminate()


Harvests = Latest[Run]
