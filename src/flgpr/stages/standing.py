"""Data freed from what stands still on the vehicle."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Annotated, Any, ClassVar

import numpy as np
from pydantic import Field

from flgpr.clutter import standing_field, subtract_standing
from flgpr.engine import Accumulator, PlannedPass, append_accumulator
from flgpr.model import Grid
from flgpr.stages import ClutterStage, Table, scan_bytes
from flgpr.types import Arrays, ComplexArray, IndexArray


class StandingSettings(Table):
    """``most`` scans, spread evenly over the run, give the median."""

    most: Annotated[int, Field(ge=3)] = 64


def spread_scans(scans: int, most: int) -> IndexArray:
    """Return at most so many of a run's scans, spread evenly from its first to its last."""
    return np.unique(np.linspace(0, scans - 1, min(scans, most)).round().astype(np.intp))


def standing_pass(
    name: str,
    scans: int,
    most: int,
    read: Callable[[int], ComplexArray | None],
    estimate: Callable[[ComplexArray], ComplexArray] = standing_field,
    least: int = 1,
) -> PlannedPass:
    """Return the pass that estimates a standing field from scans spread evenly over the run.

    Parameters
    ----------
    name : str
        Name of the pass.
    scans : int
        Number of complete scans.
    most : int
        Number of scans that it reads at most.
    read : callable
        Returns the data (polarization, pair, frequency) of the scan at an index; None: it has none.
    estimate : callable
        Returns the field of data (scan, polarization, pair, frequency).
    least : int
        Scans with data without which there is no field.

    Returns
    -------
    PlannedPass
        Its result holds the ``field``.
    """
    chosen = set(spread_scans(scans, most).tolist())

    def start(block: range | None) -> Accumulator:  # noqa: ARG001
        pieces: list[Arrays] = []

        def add(index: int) -> None:
            data = read(index) if index in chosen else None
            if data is not None:
                pieces.append({"signal": data[None]})

        gathered = append_accumulator(pieces, add)

        def result() -> Arrays:
            signal = gathered.result().get("signal", np.empty(0, np.complex64))
            return {"field": estimate(signal)} if len(signal) >= least else {}

        return Accumulator(add, gathered.state, gathered.merge, result)

    return PlannedPass(name, "standing field", start, all_scans=True)


class StandingField(ClutterStage):
    """Subtracts the median of the data over the run, fitted to every scan's gain."""

    not_live_because = "only the whole run shows what stands still"
    Settings: ClassVar[type[Table]] = StandingSettings

    @classmethod
    def memory(cls, settings: Any, sizes: Mapping[str, int], image: Grid) -> float:  # noqa: ARG003
        """Estimate the bytes of the scans of the median and its copies."""
        scans = min(settings.most, sizes["scan"])
        return 4 * scans * scan_bytes(sizes)

    def passes(self) -> list[PlannedPass]:
        """Return the pass that estimates the field."""
        scans = len(self.setup.imager)
        return [standing_pass("standing", scans, self.settings.most, self._data_before)]

    def clean(self, index: int, data: ComplexArray) -> ComplexArray:  # noqa: ARG002
        """Return the data without the field."""
        return subtract_standing(data, self.setup.results["standing"]["field"])
