"""The network: Zenoh sessions, the hosts of agents, their mail. Nothing here simulates."""
