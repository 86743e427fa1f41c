"""Bounds of the numbers in files of entries: recipes, scenes, sensors, bodies. Every number has some and is finite."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, ValidationInfo, field_validator

LARGEST = 1e6
"""Magnitude up to which a number is taken whose entry does not say another: 1000 km in metres, 10⁶ pixels."""


@dataclass(frozen=True)
class Largest:
    """Marks an entry whose numbers may have another magnitude than ``LARGEST``."""

    value: float


Positive = Annotated[float, Field(gt=0)]
NotNegative = Annotated[float, Field(ge=0)]
Hertz = Annotated[float, Field(gt=0), Largest(1e12)]
Decibels = Annotated[float, Field(ge=-300, le=300)]
"""A level whose power, and that of its amplitude, is a number with room to spare."""
Spacing = Annotated[float, Field(ge=1e-3, le=100)]
"""Distance of pixels, m: from a millimetre."""
Angle = Annotated[float, Field(ge=-2 * math.pi, le=2 * math.pi)]


class Entries(BaseModel):
    """A table of a file: unknown entries are refused, nothing changes once it is read, and every number is bounded."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    @field_validator("*", mode="after")
    @classmethod
    def _bounded(cls, value: Any, info: ValidationInfo) -> Any:
        marks = cls.model_fields[info.field_name or ""].metadata
        largest = next((one.value for one in marks if isinstance(one, Largest)), LARGEST)
        for number in _numbers(value):
            if not abs(number) <= largest:
                raise ValueError(
                    f"must lie between {-largest:g} and {largest:g}, got {_short(number)}"
                )
        return value


def _numbers(value: Any) -> Iterator[float]:
    if isinstance(value, int | float):
        yield value
    elif isinstance(value, list | tuple):
        for one in value:
            yield from _numbers(one)
    elif isinstance(value, Mapping):
        for one in value.values():
            yield from _numbers(one)


def _short(number: float) -> str:
    """Write a number, of however many digits, in a few."""
    text = str(number)
    return text if len(text) < 30 else f"{text[:20]}... of {len(text)} digits"
