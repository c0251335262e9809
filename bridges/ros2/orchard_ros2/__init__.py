"""A bridge between the Orchard and ROS 2.

It knows the Orchard from keyspace.md alone, and imports nothing of it.
"""
