"""The inside of the physics process, which owns the world and the clock.

It decides nothing about how an agent behaves. `RunLoop` (loop.py) drives a run: it publishes what
the agents observe (publisher.py), takes their answers (inbound.py, drivers.py), waits until the
barrier has all of them (barriers.py), and does the step (run.py).
"""
