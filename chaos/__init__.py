"""A seeded soak test: harvests under random kills, freezes, full disks, network faults and
malformed messages. See docs/reliability.md.
"""
