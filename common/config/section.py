"""Base class and value types of all tables of the configuration."""

from __future__ import annotations

from typing import Annotated, TypeVar

from pydantic import BaseModel, ConfigDict, Field

Positive = Annotated[float, Field(ge=1e-9, le=1e9)]
NonNegative = Annotated[float, Field(ge=0, le=1e9)]
Pair = tuple[NonNegative, NonNegative]
Coordinate = Annotated[float, Field(ge=-100.0, le=100.0)]
Xyz = tuple[Coordinate, Coordinate, Coordinate]
SectionT = TypeVar("SectionT", bound=BaseModel)


class Section(BaseModel):
    """Base of every table: frozen, strict about types, no unknown keys, no NaN or infinity."""

    model_config = ConfigDict(frozen=True, strict=True, extra="forbid", allow_inf_nan=False)


def replaced(section: SectionT, **changes: object) -> SectionT:
    """A copy of a table with other values, unchecked: for values that were computed or drawn, not read from a file.

    Unlike ``model_copy`` it takes over nothing that the original derived from its old values.
    """
    fields = {name: getattr(section, name) for name in type(section).model_fields}
    return type(section).model_construct(**(fields | changes))
