"""A bridge between the Orchard and fleet control: carriers and pickers as vehicles of VDA 5050,
over MQTT. README.md beside this package explains it to users.

Words of the standard that the code uses: an order is a way of nodes and edges, with actions at
them. Its first part is released, and is called the base; the rest, where the vehicle may not drive
yet, is the horizon. An update of the order releases more, or replaces the horizon. The last node of
the base is the decision point. An instant action, such as a pause, is done at once, beside any
order. A state is the message in which a vehicle says how far it is.

Nodes are named by what they are for: `queue/1` is the head of a line of the queue, `bay` the
unloading bay, `east/stop/3` the place at the eastern end of row 3 where a picker gets its empty
bin, and `east/bin/3` that where the full bin is coupled. Those of pickers stand in
orchard/roads/pickers.py.
"""
