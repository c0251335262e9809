"""The door to the event model: a whole harvest, or a long run of it, and its figures.

People and animals are random delays there, and there are neither ticks nor lasers.
"""
