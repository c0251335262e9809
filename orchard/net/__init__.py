"""The network: Zenoh sessions, the hosts of agents, their mail. Nothing here simulates.

A host (host.py) is a process that runs agents. It talks over a bus (bus.py, zenoh_bus.py) with
physics (orchard/server), and with other hosts about mail (mailbox.py).
"""
