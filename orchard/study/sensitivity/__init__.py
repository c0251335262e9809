"""What a result hangs on: each of some values is moved, and the effect of each one is told."""
