"""The wire format: messages with their fields and bounds, the table of keys, and conversions from and to the types of the simulator.

Nothing here sends or receives. A change here changes keyspace.md.
"""
