"""The network: Zenoh sessions, the hosts of agents, their mail, and when all answers to a tick are in. Nothing here simulates."""
