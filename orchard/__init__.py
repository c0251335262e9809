"""A kiwifruit orchard harvested by robots: the library. Start reading at `orchard/local.py`."""
