"""A whole run in one program: its processes in virtual time, over a simulated network, with faults.

A schedule is one such run. Its seed gives its plan (drawing.py, plan.py). schedule.py carries the
plan out: it starts the processes (processes.py, launcher.py) as tasks in virtual time
(scheduler.py) at a simulated network (network.py, router.py, link.py, session.py), and lets the
faults happen. verdict.py compares what came of it with local mode (course.py, reference.py,
harvest.py).
"""
