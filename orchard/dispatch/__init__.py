"""Which carrier fetches which bin, and when it leaves: the policies, and what they weigh."""
