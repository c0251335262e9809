"""The page in the browser: set up an orchard, see its plan, run it and watch it. `orchard app` serves the page.

This is the only package that imports NiceGUI. The page starts each run through the command `orchard`, as a user does in a terminal.
"""
