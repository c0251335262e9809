"""The picture in Rerun: frames become a recording, and a blueprint arranges it.

This is the only package that imports Rerun. Nothing here changes a run.
"""
