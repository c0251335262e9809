"""The picture: frames -> a Rerun recording. The one place for rerun."""

from orchard.view.recorder import Recorder, optimize

__all__ = ["Recorder", "optimize"]
