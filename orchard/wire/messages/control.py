"""Pause, step, reset and emergency stop."""

from typing import Annotated, Literal

from msgspec import Meta

from orchard.contract.agent import MOST_STEPS
from orchard.contract.messages import Text
from orchard.wire.messages.values import MOST_BODIES, Message, Name, RunMessage

SIMULATION = (
    "'stopped': before the first tick, physics waits for agents; 'paused': simulated time "
    "stands; 'quitting': the run is over"
)
ROBOTS = "robots or kinds of robots: 'picker_01', 'carrier'; empty: all robots"
StateOfSimulation = Literal["stopped", "playing", "paused", "quitting"]


class SimulationState(Message):
    """The result of GetSimulationState in ROS's simulation_interfaces. The names are those of its
    constants without `STATE_`.
    """

    state: Annotated[StateOfSimulation, Meta(description=SIMULATION)]


class SetSimulationState(RunMessage):
    """SetSimulationState in simulation_interfaces."""

    state: Annotated[
        Literal["playing", "paused", "quitting"], Meta(description="'quitting' ends the run now")
    ]


class StepSimulation(RunMessage):
    """StepSimulation in simulation_interfaces."""

    steps: Annotated[
        int,
        Meta(
            ge=1, le=MOST_STEPS, description="how many steps of 0.1 s; then the run is paused again"
        ),
    ] = 1


class ResetSimulation(RunMessage):
    """ResetSimulation in simulation_interfaces."""

    seed: Annotated[
        int | None, Meta(description="of the scenario from now on, 0 or more; nil: as before")
    ] = None


class Stop(RunMessage):
    """An emergency stop of robots, or its reset."""

    stop: Annotated[
        bool,
        Meta(
            description=(
                "true: the robots stand from the present step on, until they are reset; false: "
                "they are reset"
            )
        ),
    ]
    names: Annotated[list[Text], Meta(max_length=MOST_BODIES, description=ROBOTS)]


class Stopped(Message):
    """The stop or reset is in force, beginning with the step from this tick to the next."""

    changed: Annotated[
        list[Name],
        Meta(
            description="robots that this query stopped or reset, without those that already were"
        ),
    ]
    stopped: Annotated[list[Name], Meta(description="all robots that are stopped now")]
    kept: Annotated[
        bool,
        Meta(
            description=(
                "whether it is on the disk; else it is in force, but is lost if physics dies now"
            )
        ),
    ] = False
