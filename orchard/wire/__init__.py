"""Messages as bytes: their fields and bounds, the table of keys, and the translation to and from what agents and physics use.

Nothing here sends or receives. A change here is a change of keyspace.md.
"""
