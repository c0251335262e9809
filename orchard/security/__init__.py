"""Security of a run: roles and their rights on keys, certificates, and their directories."""
