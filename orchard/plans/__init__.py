"""What robots do, as data and steps: plans, routes, places, and what a robot finds in its scan."""
