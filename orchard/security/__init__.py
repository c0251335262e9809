"""Security of a run: roles and their rights on keys, certificates, and their directories. `net.zenoh_bus` uses these files."""
