"""Recordings of the small orchard, from which bags are made."""

from local_runs import SMALL

from orchard.field.layout import lay_out
from orchard.local import Local
from orchard.sim.frames import FrameBuilder
from orchard.view.recorder import Recorder

# The ticks of a recording.
TICKS = 40


def record(file, ticks=range(1, TICKS + 1), gap=None):
    """Record some ticks of a run. Return pose, twist and wanted velocities of each tick.

    `gap`: the arguments of `Recorder.gap`, for a gap before them.
    """
    local = Local(SMALL)
    recorder = Recorder(lay_out(SMALL), "one", file)
    frames = FrameBuilder(local.engine)
    recorded = {}
    if gap is not None:
        recorder.gap(*gap)
    while local.engine.tick < max(ticks):
        events = local.tick()
        world = local.engine.world
        wanted = local.engine.lookahead.wanted
        if world.tick in ticks:
            recorder.tick(frames.frame(events))
            recorded[world.tick] = world.pose.copy(), world.twist.copy(), wanted.copy()
    assert recorder.close()
    return recorded
