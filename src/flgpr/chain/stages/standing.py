"""Data freed from what stands still on the vehicle."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Annotated, Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from flgpr.chain.engine import Accumulator, Arrays, PlannedPass, append_accumulator
from flgpr.chain.stages import ClutterStage, ComplexArray, Table
from flgpr.clutter import standing_field, subtract_standing
from flgpr.model import Grid


class StandingSettings(Table):
    """``most`` scans, spread evenly over the run, give the median."""

    most: Annotated[int, Field(ge=3)] = 64


def standing_pass(
    name: str,
    scans: int,
    most: int,
    read: Callable[[int], ComplexArray],
    estimate: Callable[[ComplexArray], ComplexArray] = standing_field,
) -> PlannedPass:
    """Make the pass that estimates the standing field from at most so many scans; ``read`` gives a scan's data."""
    chosen = set(
        np.unique(np.rint(np.linspace(0, scans - 1, min(scans, most))).astype(int)).tolist()
    )

    def start(block: range | None) -> Accumulator:  # noqa: ARG001
        parts: list[Arrays] = []

        def add(index: int) -> None:
            if index in chosen:
                parts.append({"signal": read(index)[None]})

        sums = append_accumulator(parts, add)
        return Accumulator(
            add, sums.state, sums.merge, lambda: {"field": estimate(sums.result()["signal"])}
        )

    return PlannedPass(name, "standing field", start, all_scans=True)


class StandingField(ClutterStage):
    """Subtracts the median of the data over the run, fitted to every scan's gain."""

    not_live_because = "what stands still is told by the whole run"
    Settings: ClassVar[type[Table]] = StandingSettings

    @classmethod
    def memory(cls, settings: Any, sizes: Mapping[str, int], image: Grid) -> float:  # noqa: ARG003
        """Take the scans of the median and its copies."""
        return (
            4
            * 8.0
            * min(settings.most, sizes["scan"])
            * sizes["polarization"]
            * sizes["pair"]
            * sizes["frequency"]
        )

    def passes(self) -> list[PlannedPass]:
        """Estimate the field."""
        scans = len(self.setup.imager)
        return [
            standing_pass(
                "standing", scans, self.settings.most, lambda index: self.before(index, 1)[0]
            )
        ]

    def clean(self, index: int, data: ComplexArray) -> NDArray[np.complex64]:  # noqa: ARG002
        """Subtract it."""
        return subtract_standing(data, self.setup.results["standing"]["field"])
