"""The wire format: messages, the table of keys, and conversions from and to the types of the
simulator. keyspace.md follows from it.
"""
