"""The command line: the table of its commands, and those that need no extra."""
