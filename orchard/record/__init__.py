"""The parts of the logger process, which receives a run's frames and events and writes them with `view`.

The logger only receives: a run is the same with and without it.
"""
