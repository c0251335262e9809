"""A seeded soak test: harvests under random kills, freezes, network faults and malformed messages. See docs/reliability.md."""
