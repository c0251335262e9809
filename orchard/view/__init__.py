"""The picture: frames -> a Rerun recording. The one place for rerun."""

from orchard.view.parts import optimize
from orchard.view.recorder import Recorder

__all__ = ["Recorder", "optimize"]
