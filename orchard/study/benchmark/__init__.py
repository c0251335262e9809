"""The benchmark of dispatch policies: its orchards, what a policy sees there, and its scores."""
