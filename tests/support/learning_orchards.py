"""Orchards for tests of the environments in which bodies of a harvest learn."""

from orchard.field.scenario import Animals, People, Scenario

# With a person, a dog and weeds.
SMALL = Scenario(
    rows=3, people=People(workers=1, visitors=0), animals=Animals(dogs=1, cats=0), weeds=2
)
# A harvest of it is short: each of three pickers has one row of 20 m.
TINY = Scenario(
    rows=3,
    pickers=3,
    row_length=20.0,
    people=People(workers=0, visitors=0),
    animals=Animals(dogs=0, cats=1),
    weeds=0,
)
# The bodies that learn; all others follow their built-in agents.
LEARNED = ["carrier_01", "picker_02"]
