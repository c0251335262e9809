"""Reads what people have of an orchard, its rows in a file, and makes a scenario of it.

A reader for each format gives features in the file's coordinate system; only these know formats.
Then all formats take one way: metres on the ground, lines of rows, the scenario.
"""
