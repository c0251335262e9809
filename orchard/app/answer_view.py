"""A question of the page: Start and Stop, a bar while it is computed, and its answer in words.

The page that has started a study stops it when an input changes, because the answer would be that
of another question.
"""

from collections.abc import Iterable, Sequence
from typing import Any

from nicegui import ui

from orchard.app.command import STATE_COLOURS, Latest, PageCommand
from orchard.app.elements import StartAndStop, heading, note, table
from orchard.app.study_view import last_words

# Between two looks at the command.
LOOK_SECONDS = 0.3
CHANGED = "Stopped, because something that it asks about was changed. Ask again."
INVALID = "The form has an invalid value"


class AnswerView:
    """The parts that all such questions have. A view of a question builds on it, and gives the
    methods that raise NotImplementedError here.
    """

    def __init__(self, commands: Latest[Any], name: str, question: str, hint: str) -> None:
        """`name`: before the names of all parts for tests. `question`: words of the button."""
        self._commands = commands
        # The one that this page has started, and the one that is shown with its answer.
        self._own: PageCommand | None = None
        self._shown: PageCommand | None = None
        with ui.element("div").classes("study-buttons"):
            # A change of a field stops the study, so none is locked.
            unlocked = ui.element("div").classes("hidden")
            actions = (f"{name}-start", f"{name}-stop")
            self._buttons = StartAndStop(commands, unlocked, question, self._start, actions)
            self._badge = ui.badge().props(f"data-view={name}-state")
            ui.label(hint).classes("study-hint")
        self._trouble = note(f"data-problem={name} role=alert")
        self._bar = ui.linear_progress(value=0.0, show_value=False, size="8px")
        self._bar.props(f'rounded instant-feedback aria-label="{question} What is done"')
        self._bar.props(f"data-view={name}-bar")
        self._answer = note(f"data-view={name}-answer role=status", "answer")
        self._notes = note(f"data-view={name}-notes", "classes")
        self._picture = ui.html("", sanitize=False).classes("study-picture")
        self._picture.props(f"data-view={name}-picture")
        self._table = ui.element("div").classes("summary sides").props(f"data-view={name}-table")
        # On a phone it is wider than the screen. With a tab stop the keyboard scrolls it, too.
        self._table.props('tabindex=0 role=region aria-label="Table of the answer"')
        self._table.set_visibility(False)

    # -- what a view of a question gives

    @property
    def _problem(self) -> str:
        """What is wrong with the fields of the question; '' if nothing is."""
        raise NotImplementedError

    def _problem_now(self) -> str:
        """Return what is wrong with the fields and the form together; '' if nothing is."""
        raise NotImplementedError

    def _begin(self) -> None:
        """Start the command. Raises OSError or RuntimeError."""
        raise NotImplementedError

    def _is_as_asked(self, own: Any) -> bool:
        """Whether the page still asks what this command answers."""
        raise NotImplementedError

    def _progress(self, command: Any) -> tuple[float, str]:
        """Return the share that is done, and what to say of it; '' if nothing is known yet."""
        raise NotImplementedError

    async def _show_result(self, command: Any) -> None:
        """Show what follows the words of an answer. `command`: one that has a result."""
        raise NotImplementedError

    # -- user actions

    def _update(self) -> None:
        """Show what is wrong with what is entered."""
        self._trouble.set_text(self._problem)
        self._update_buttons()

    def _start(self) -> None:
        self._trouble.set_text(self._try_to_start())
        self._update_buttons()

    def _try_to_start(self) -> str:
        """Start the command. Return why it was not started; '' if it was."""
        problem = self._problem_now()
        if problem:
            return problem
        try:
            self._begin()
        except (OSError, RuntimeError) as error:
            return f"The study was not started: {error}"
        self._own = self._commands.command
        return ""

    # -- updates

    def _show_table(
        self, title: str, heads: Sequence[str], lines: Iterable[Sequence[str]], legend: str
    ) -> None:
        """Show the table of an answer. `lines`: the cells of each line."""
        self._table.set_visibility(True)
        with self._table:
            heading(3, title)
            table(lines, heads)
            ui.label(legend).classes("path")

    def _stop_if_changed(self) -> None:
        """Stop what this page has started, if it asks about something else by now."""
        own = self._own
        if own is None or own.is_over or own.asked_to_stop or self._is_as_asked(own):
            return
        own.stop()
        self._trouble.set_text(CHANGED)

    def _update_buttons(self) -> None:
        command = self._commands.command
        self._buttons.update(not self._problem)
        self._badge.set_visibility(command is not None)
        self._bar.set_visibility(False)
        if command is None:
            return
        state = command.state
        self._badge.set_text(state)
        self._badge.props(f"color={STATE_COLOURS[state]}")
        self._bar.set_visibility(not state.is_over)
        self._bar.set_value(self._progress(command)[0])

    async def _watch(self) -> None:
        """Show what is new."""
        self._stop_if_changed()
        self._update_buttons()
        command = self._commands.command
        if command is None or command is self._shown:
            return
        if not command.is_over:
            last = "\n".join(["The runs begin.", *command.output.lines[-1:]])
            self._show_words(self._progress(command)[1] or last)
            return
        self._shown = command
        if command.result is None:
            self._show_words(last_words(command))
            return
        self._show_words(command.result.answer)
        self._notes.set_text("\n".join(command.result.notes))
        await self._show_result(command)

    def _show_words(self, words: str) -> None:
        """Show these words, and nothing of an answer before."""
        if self._answer.text == words:
            return
        self._answer.set_text(words)
        self._notes.set_text("")
        self._picture.set_content("")
        self._table.clear()
        self._table.set_visibility(False)
