"""Security of a run: roles and their rights on keys, certificates, and their directories. `net.bus` opens sessions with these files."""
