"""A whole run in one program: its processes in virtual time, over a simulated network, with faults.

One seed gives one schedule.
"""
