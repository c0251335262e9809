"""The scenario: what a user may set, with its limits. The one place for YAML."""

import math
from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field, model_validator

TIME_STEP = 0.1  # s


class _Section(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)


Count = Annotated[int, Field(ge=0, le=50)]


class People(_Section):
    """Workers and visitors: at most 50 together."""

    workers: Count = 4
    visitors: Count = 3


class Animals(_Section):
    """Dogs and cats: at most 50 together."""

    dogs: Count = 2
    cats: Count = 1


class Laser(_Section):
    """What all lasers have in common."""

    noise: Annotated[float, Field(ge=0.0, le=0.1, description="standard deviation of a range, m")] = 0.0


class Scenario(_Section):
    """An orchard, its machines and its guests."""

    rows: Annotated[int, Field(ge=3, le=20)] = 5
    pickers: Annotated[int, Field(ge=2, le=20)] = 2
    row_width: Annotated[float, Field(ge=5.0, le=12.0)] = 5.0
    carriers: Annotated[int, Field(ge=1, le=40)] | None = None
    picking_speed: Annotated[float, Field(ge=0.02, le=1.0)] = 1.0
    seed: Annotated[int, Field(ge=0, lt=2**63)] = 1
    people: People = People()
    animals: Animals = Animals()
    weeds: Count = 10
    tractor: bool = True
    laser: Laser = Laser()

    @property
    def carrier_count(self) -> int:
        """Carriers, by default 7 for every 10 pickers, rounded up (manual)."""
        return self.carriers if self.carriers is not None else math.ceil(self.pickers * 7 / 10)

    @model_validator(mode="after")
    def _no_idle_pickers(self) -> "Scenario":
        if self.pickers > self.rows:
            raise ValueError(f"pickers: {self.pickers} is more than rows: {self.rows}; at most one picker a row")
        return self
