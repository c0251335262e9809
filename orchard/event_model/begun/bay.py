"""What the bay has at a moment: bins on trailers, trailers that are away, and bins that wait."""

from orchard.event_model.begun.moment import RunMoment
from orchard.event_model.harvest import EventHarvest


def take_over_bay(moment: RunMoment, harvest: EventHarvest) -> None:
    """Set the trailers, and the full bins that wait for the truck."""
    world = moment.world
    trailers = harvest.model.trailers
    for column, values in zip(("bins", "back", "taken"), world.trailers.T, strict=True):
        trailers[column] = values[: len(trailers)]
    desk = harvest.model.desk[0]
    desk.waiting_bins = world.waiting_bins
    if desk.truck_ticks:
        # It has come so often by the last tick.
        desk.trucks = (moment.tick - 1) // desk.truck_ticks
