"""What the Orchard publishes to ROS 2, as plain data: topics, messages, maps, descriptions of
robots, and their bytes.

No ROS is needed, and nothing of the Orchard. The Orchard installs these files too, as its package
`orchard.bags.plain`, and writes bags with them: so they import each other by relative names.
"""
