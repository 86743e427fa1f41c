"""What a draft finds besides the signal: positions of antennas, and where the vehicle was."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from flgpr.formats.draft_groups import ArraySource, FileGroup
from flgpr.types import FloatArray

_FORMS = (("position",), ("x", "y"), ("longitude", "latitude"))
"""Components that tell a place together."""


@dataclass
class Antennas:
    """Antennas of one kind: where their positions lie, and how many they are."""

    source: ArraySource
    count: int
    unit: str
    reason: str = ""  #: why it is that unit
    values: FloatArray | None = None  #: (antenna, 3) where they are some rows of a list
    sides: Sequence[ArraySource] = ()  #: x, y and z where they lie apart

    @property
    def scans(self) -> int | None:
        """How many scans have positions of their own, in the lane frame; None if one has all."""
        shape = self.source.info.shape
        return shape[0] if len(shape) == 3 else None


@dataclass
class Places:
    """Where the vehicle was: arrays of one file by component, with times if there are any."""

    group: FileGroup
    columns: dict[str, ArraySource]
    is_table: bool  #: whether it is a table of fixes in a file of its own, not beside the signal

    @property
    def count(self) -> int:
        """How many fixes there are."""
        return next(iter(self.columns.values())).rows

    def holds(self, *names: str) -> bool:
        """Return whether all of these components are there."""
        return set(names) <= set(self.columns)

    @property
    def form(self) -> tuple[str, ...]:
        """The components that tell where the vehicle was; empty where it is height or heading.

        Beside the signal, x and y are in the lane and stand for longitude and latitude. Those of a
        table of fixes may be in any frame.
        """
        forms = (_FORMS[0], _FORMS[2], _FORMS[1]) if self.is_table else _FORMS
        return next((form for form in forms if self.holds(*form)), ())

    @property
    def are_geodetic(self) -> bool:
        """Whether positions are longitudes and latitudes."""
        return self.form == ("longitude", "latitude")

    def keep_form(self) -> None:
        """Take components out that others stand for."""
        for name in {name for form in _FORMS for name in form}.difference(self.form or ("x", "y")):
            self.columns.pop(name, None)

    def precedence(self) -> tuple[bool, bool, int]:
        """Return what makes one file's places go before another's."""
        return bool(self.form), not self.are_geodetic, len(self.columns)
