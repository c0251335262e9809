"""The messages on the wire: ROS's names, SI units, bounds. Each is a msgpack map; what its fields say here, keyspace.md repeats."""
