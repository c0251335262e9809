"""The roads of an orchard as fleet control knows them: nodes, edges, what a vehicle does there, and
a map of them.

The bridge to VDA 5050 (bridges/vda5050) drives vehicles on them. Read graph.py first.
"""
