"""Recordings of the small orchard, from which bags are made."""

from local_runs import SMALL

from orchard.field.layout import lay_out
from orchard.local import Local
from orchard.sim.frames import FrameBuilder
from orchard.view.recorder import Recorder

# How many ticks a recording has: 4 s.
TICKS = 40


def record(file, ticks=range(1, TICKS + 1), gap=None):
    """Record some ticks of a run of the small orchard into a file.

    `gap`: the arguments of `Recorder.gap`, if the recording begins with ticks that were lost.
    Return tick -> (pose, twist, wanted velocities), each an array (bodies, 3) as in `World`.
    """
    local = Local(SMALL)
    recorder = Recorder(lay_out(SMALL), "a run", file)
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
