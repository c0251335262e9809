"""The page: set an orchard up in the browser, run it, and watch it. The one place for NiceGUI.

`python -m orchard.app` serves it on the loopback. What it runs is `run.py`, as one would by hand.
"""
