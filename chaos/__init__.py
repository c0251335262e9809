"""A seeded soak test: harvests of real processes under random faults. See docs/reliability.md.

Faults are kills, freezes, full disks, a bad network and malformed messages. schedule.py draws them
from a seed, soak.py does one run after the other, fault_injection.py injects the faults of a run,
and oracle.py judges it. chaos/simulated does the same in one program, in virtual time.
"""
