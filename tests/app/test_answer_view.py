"""A question of the page is stopped when what it asks about is changed.

No browser and no command take part: a study may be done before a browser has changed a field.
"""

import pytest
from page_server import skip_without_packages

skip_without_packages()

from orchard.app.answer_view import CHANGED, AnswerView  # noqa: E402


class Command:
    """A study that goes on until it is stopped."""

    is_over = False
    asked_to_stop = False

    def stop(self):
        self.asked_to_stop = True


class Trouble:
    """Where a question says what is wrong."""

    text = ""

    def set_text(self, text):
        self.text = text


class Question(AnswerView):
    """A question whose page has started a command; nothing of it is drawn."""

    def __init__(self, own, is_same):
        self._own = own
        self._trouble = Trouble()
        self._is_same = is_same

    def _is_as_asked(self, own):
        return self._is_same


@pytest.mark.parametrize("is_same", [True, False])
def test_a_change_of_an_input_stops_what_was_asked(is_same):
    command = Command()
    question = Question(command, is_same)
    question._stop_if_changed()
    assert command.asked_to_stop is not is_same
    assert question._trouble.text == ("" if is_same else CHANGED)
