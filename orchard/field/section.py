"""What all sections of a scenario are: maps with known keys, strictly typed, with rules about several of their fields."""

from functools import reduce

from pydantic import BaseModel, ConfigDict
from pydantic_core import PydanticCustomError


class Section(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)

    def _demand(self, holds: bool, text: str, *fields: str) -> None:
        """Check a rule about several fields, named by dotted paths. Raise an error that names them and their values unless it holds."""
        if not holds:
            values = [reduce(getattr, field.split("."), self) for field in fields]
            raise PydanticCustomError("rule", "{text}", {"text": text, "fields": fields, "values": values})
