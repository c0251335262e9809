"""The agents: robots, bins, people, animals, weeds, and the desks for traffic and dispatch."""
