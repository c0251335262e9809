"""Whether the physics of a run is there, and whether the run is over.

Physics has a liveliness token, which goes when physics ends. There are two for a while if the
router has not noticed that the link of a dead physics is closed. A run that is reset begins again
with a new token:

| what is heard | what it means |
|---|---|
| a token comes | physics is there |
| the last token goes | physics is away; it may come back |
| `end`, and within 3 s the last token goes | the run is over |
| `end` with the reason reset | a token that is not known yet is of the new run |

In a secured run all sessions of physics have one id. So a token that comes back there has the name
of the one before, and is that of the new run.
"""

from collections.abc import Callable
from time import monotonic, sleep

# An `end` counts if the token of physics goes within this time.
GOES_SECONDS = 3.0
# A run that is reset may take this long to begin again.
BEGIN_SECONDS = 60.0
# Between two looks at whether it has.
LOOK_SECONDS = 0.02


class PhysicsWatch:
    """The tokens of physics. One thread notes them, and others wait for new ones."""

    def __init__(self, are_names_reused: bool) -> None:
        """`are_names_reused`: whether tokens that come back have the names of those before."""
        self._are_names_reused = are_names_reused
        self._tokens = frozenset[str]()
        # The tokens before the newest reset.
        self._before_reset = frozenset[str]()
        # The tokens before the reset that this bridge has asked for.
        self._before_request = frozenset[str]()
        # The reason in the newest `end`, and when it came, s on the monotonic clock.
        self._why_ended = ""
        self._ended_at = 0.0
        # It answered when the bridge asked for the layout; its first token comes soon.
        self.is_up = True

    # -- what is heard

    def note_token(self, token: str, is_up: bool) -> None:
        """Note that a token has come, or is gone."""
        name = frozenset([token])
        if is_up:
            self._tokens |= name
        else:
            self._tokens -= name
            if self._are_names_reused:
                self._before_reset -= name
                self._before_request -= name
        self.is_up = bool(self._tokens)

    def note_reset(self) -> None:
        """Note that the run has been reset: the tokens that there are go."""
        self._before_reset = self._tokens

    def note_end(self, why: str) -> None:
        """Note that the run has said that it ends."""
        self._why_ended = why
        self._ended_at = monotonic()

    @property
    def why_over(self) -> str:
        """Why the run is over; '' while it is not.

        An `end` counts only with the token of physics, which only physics can take away.
        """
        if not self._why_ended or self.is_up:
            return ""
        if monotonic() - self._ended_at >= GOES_SECONDS:
            return ""
        return f"the run is over: {self._why_ended}"

    # -- what a service waits for

    def note_request(self) -> None:
        """Note that this bridge is about to ask for a reset."""
        self._before_request = self._tokens

    @property
    def has_begun_again(self) -> bool:
        """Whether physics has a token that was not there when this bridge asked for a reset."""
        return bool(self._tokens - self._before_request)

    @property
    def _is_of_newest_run(self) -> bool:
        return bool(self._tokens - self._before_reset)

    def await_newest_run(self) -> None:
        """Wait until physics is that of the run after the newest reset, or has had its time."""
        self._await(lambda: self._is_of_newest_run)

    def await_requested_run(self) -> None:
        """Wait until the run begins again for which this bridge has asked, or has had its time."""
        self._await(lambda: self.has_begun_again)

    def _await(self, has_begun: Callable[[], bool]) -> None:
        end = monotonic() + BEGIN_SECONDS
        while not has_begun():
            if monotonic() > end:
                # No service waits again for what does not come.
                self._before_reset = frozenset()
                return
            sleep(LOOK_SECONDS)
