"""Bounds of the numbers in TOML files: recipes, scenes, sensors, bodies.

Every number has bounds and is finite.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, ValidationInfo, field_validator

LARGEST = 1e6
"""Largest magnitude of a number whose entry states no other: 1000 km in metres, 10⁶ pixels."""


@dataclass(frozen=True)
class Largest:
    """Mark an entry whose numbers may have another magnitude than ``LARGEST``."""

    value: float


Positive = Annotated[float, Field(gt=0)]
NotNegative = Annotated[float, Field(ge=0)]
Share = Annotated[float, Field(ge=0, le=1)]
Moderate = Annotated[float, Field(ge=0, le=100)]
"""A number whose square and exponential do not overflow."""
AtLeastOne = Annotated[int, Field(ge=1)]
Hertz = Annotated[float, Field(gt=0), Largest(1e12)]
Decibels = Annotated[float, Field(ge=-300, le=300)]
"""A level whose power does not overflow."""
Spacing = Annotated[float, Field(ge=1e-3, le=100)]
"""Distance of pixels, m: from a millimetre."""
Angle = Annotated[float, Field(ge=-2 * math.pi, le=2 * math.pi)]


class Entries(BaseModel):
    """A table of a file: it refuses unknown entries, is frozen, and bounds every number."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    @field_validator("*", mode="after")
    @classmethod
    def _bounded(cls, value: Any, info: ValidationInfo) -> Any:
        marks = cls.model_fields[info.field_name or ""].metadata
        largest = LARGEST
        for mark in marks:
            if isinstance(mark, Largest):
                largest = mark.value
                break
        for number in _numbers(value):
            if not abs(number) <= largest:
                raise ValueError(
                    f"must lie between {-largest:g} and {largest:g}, got {shown_number(number)}"
                )
        return value


def _numbers(value: Any) -> Iterator[float]:
    """Iterate over all numbers of a nested value."""
    if isinstance(value, int | float):
        yield value
    elif isinstance(value, list | tuple):
        for element in value:
            yield from _numbers(element)
    elif isinstance(value, Mapping):
        for element in value.values():
            yield from _numbers(element)


def shown_number(number: float) -> str:
    """Return a number as a short text, however many digits it has."""
    try:
        text = str(number)
    except ValueError:  # Python does not write integers of thousands of digits
        return "an integer of too many digits to be shown"
    return text if len(text) < 30 else f"{text[:20]}... of {len(text)} digits"
