"""The roads of an orchard as fleet control knows them: nodes, edges, what a vehicle does there, and
a map of them.
"""
