"""What a result depends on: `orchard study --sensitivity`.

Some values of a scenario, the factors, are moved through ranges, all at once. A point is a value
for each of them. Two harvests are done at each point, and a fit to their results says which share
of the variance of the results each value has.
"""
