"""Orchards in which one thing at a time happens."""

from stage import Stage, empty_orchard

from orchard.field.scenario import Animals, People


def meadow(**changes) -> Stage:
    """An orchard whose pickers and carriers do nothing until they are given a plan; carrier_01 stands free of the others."""
    stage = Stage(empty_orchard(**changes))
    for name in stage.local.agents:
        if name.startswith(("picker", "carrier")):
            stage.give(name, [])
    return stage


def one_guest(kind: str, x: float, y: float, heading: str = "EAST") -> Stage:
    """An orchard with one worker, visitor, dog or cat, no other person or animal, and no robot at work."""
    people = People(workers=int(kind == "worker"), visitors=int(kind == "visitor"))
    animals = Animals(dogs=int(kind == "dog"), cats=int(kind == "cat"))
    stage = meadow(people=people, animals=animals)
    stage.put(f"{kind}_01", x, y, heading)
    return stage
