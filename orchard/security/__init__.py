"""Who may do what on which key: roles, certificates, and the directories that hold them.

Nothing here opens a connection to a run; `net.bus` uses what is made here.
"""
