"""The page in the browser: set up an orchard, see its plan, run it and watch it. `python -m orchard.app` serves it.

This is the only package that imports NiceGUI. A run is started through `run.py`, as by hand.
"""
