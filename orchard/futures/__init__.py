"""What comes of a run from one of its moments on: forks, futures, and the moment that decides.

This is the command `orchard fork`. A "moment" is the state of a run between two ticks, as a
snapshot. A "fork" is one run that goes on from it. A "future" is a run in local mode from it to its
end, of which only the figures are kept: to "live" it is to do that run. A "branch" is a set of
changes, with as many futures as there are seeds.
"""
