"""Keys for caches of what follows from a layout, and is the same for many of them."""

from dataclasses import dataclass, field

from orchard.field.layout import Layout
from orchard.field.rows import Block


@dataclass(frozen=True)
class Geometry:
    """A key for caches of what follows from a layout and does not depend on the seed.

    Layouts that differ by the seed alone have equal keys, although rows are picked at different
    speeds in them.
    """

    #: As JSON.
    scenario: str
    # The text of a scenario has null for hours of a battery that are infinite. Such a scenario has
    # charging lines, and one with null has none.
    queue_places: int
    blocks: tuple[tuple[str, Block], ...]
    #: One of the layouts with this key, from which the cached value is made.
    layout: Layout = field(compare=False)

    @classmethod
    def of(cls, layout: Layout, has_seed: bool = False) -> "Geometry":
        """Return the key of a layout.

        `has_seed`: whether the seed is a part of the key, as where a user's code may read it.
        """
        scenario = layout.scenario
        if not has_seed:
            scenario = scenario.model_copy(update={"seed": 0})
        return cls(
            scenario=scenario.model_dump_json(),
            queue_places=layout.queue_places,
            blocks=tuple(layout.blocks.items()),
            layout=layout,
        )

    @classmethod
    def of_pickers(cls, layout: Layout) -> "Geometry":
        """Return a key of what does not depend on the number of carriers either."""
        scenario = layout.scenario.model_copy(update={"seed": 0, "carriers": None})
        return cls(
            scenario=scenario.model_dump_json(),
            queue_places=0,
            blocks=tuple(layout.blocks.items()),
            layout=layout,
        )
