"""Security of a run: roles and their rights on keys, certificates, and their directories.

A role (roles.py) says what a process may do. A directory for each role (identity.py) holds its
certificate (certificates.py). `orchard secure` makes them, and `--secure DIR` uses them.
"""
