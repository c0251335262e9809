"""The page in the browser.

It starts each run through the command `orchard`, as a user does in a terminal.
"""
