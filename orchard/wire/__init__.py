"""The wire format: messages, the table of keys, and conversions.

The conversions (codec.py) lead from and to the types of the simulator. keyspace.md follows from the
messages and the table (keys.py).
"""
