"""Security of a run: roles and their rights on keys, certificates, and the directories that hold them.

No module here opens a session; `net.bus` does so with the files that are made here.
"""
