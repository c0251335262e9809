"""The logger process from the inside: it receives a run's frames and events and writes them with `view`.

It only listens; a run is the same with and without it.
"""
