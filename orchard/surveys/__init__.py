"""Reads the rows of an orchard from a file, and makes a scenario of them: `orchard layout import`.

There is a reader for each format (geojson.py, kml.py, table.py, layers.py). It returns features in
the file's coordinate system (features.py); only readers know formats. Then all formats take one
way, which importing.py goes: the features that are rows, metres on the ground, lines of rows, the
scenario.
"""
