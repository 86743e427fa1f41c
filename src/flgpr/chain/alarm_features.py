"""Features of alarms gathered scan by scan, alike for a stored run, its sections, and scans as they come."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

from flgpr.chain.engine import Arrays, bundle_groups, group_of
from flgpr.chain.stages import ComplexArray, FeatureStage
from flgpr.chain.steps import CleanedScan, Steps
from flgpr.features import POLARIMETRIC, ContrastSums, FeatureSettings, FeatureSums
from flgpr.model import ground_points, lane_to_scan

SWAPPED = "swapped."
OTHER_GAIN = {"shared": "paper.", "own": "shared."}
"""Prefixes of the variants' columns: regions exchanged, and the polarimetric features with the other gain.

``paper.`` are those with a gain of each polarization's own.
"""
OTHER_PSI: dict[str, Literal["circular", "linear"]] = {"circular": "linear", "linear": "circular"}
"""The other mean of ψ; before P_psi, behind what names the gain, it marks the variants' columns of it."""
_PSI_OF_GAIN: dict[str, Literal["circular", "linear"]] = {"shared": "circular", "own": "linear"}


class StageSums:
    """Means over the scans of what a feature stage gives for alarms (x, y in the lane frame, m)."""

    def __init__(self, stage: FeatureStage, alarms: pd.DataFrame) -> None:
        self.stage = stage
        self._points = ground_points(alarms)
        self._total = np.zeros((len(alarms), len(stage.columns)))
        self._count = np.zeros(self._total.shape, np.int64)

    def add(self, image: xr.DataArray) -> None:
        """Take in one cleaned image."""
        found = self.stage.of_image(
            image, lane_to_scan(self._points, np.asarray(image.attrs["pose"]))[:, :2]
        )
        values = np.stack(
            [np.asarray(found[name], dtype=np.float64) for name in self.stage.columns], axis=1
        )
        self._total += np.nan_to_num(values)
        self._count += np.isfinite(values)

    def state(self) -> Arrays:
        """Return sums and counts by row of the alarms."""
        return {"row": np.arange(len(self._points)), "total": self._total, "count": self._count}

    def merge(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Take in what another gathered of other scans."""
        self._total[state["row"]] += state["total"]
        self._count[state["row"]] += state["count"]

    def table(self) -> pd.DataFrame:
        """Compute the means; NaN where no scan gave a value."""
        with np.errstate(invalid="ignore"):
            means = np.where(self._count > 0, self._total / np.maximum(self._count, 1), np.nan)
        return pd.DataFrame(means, columns=list(self.stage.columns))


class AlarmSums:
    """Features of alarms (x, y in the lane frame, m), gathered scan by scan.

    ``rows``, ascending, are their numbers among all.
    """

    def __init__(
        self, steps: Steps, alarms: pd.DataFrame, rows: NDArray[np.intp] | None = None
    ) -> None:
        self._steps = steps
        self.rows = np.arange(len(alarms)) if rows is None else rows
        recipe = steps.recipe
        table = steps.recipe.features
        patch = steps.recipe.contrast.patch()
        self._contrast: ContrastSums | None = None
        self._ten: dict[str, FeatureSums] = {}  # by prefix
        if table is None:
            self._contrast = ContrastSums(alarms, steps.grid, recipe.run_view.y_max, patch)
        else:
            main = FeatureSettings(
                patch, table.inner, recipe.run_view.y_max, table.psi, steps.polarimetric
            )
            settings = {"": main}
            self._gain: dict[str, str] = {"": table.gain, SWAPPED: table.gain}
            if table.variants:
                other = "own" if table.gain == "shared" else "shared"
                prefix = OTHER_GAIN[table.gain]
                self._gain[prefix] = other
                settings[SWAPPED] = main.swapped()
                settings[prefix] = FeatureSettings(
                    patch, main.inner, main.y_max, _PSI_OF_GAIN[other]
                )
            self._ten = {
                prefix: FeatureSums(alarms, steps.polarizations, steps.subbands, steps.grid, one)
                for prefix, one in settings.items()
            }
        self._stages = {name: StageSums(one, alarms) for name, one in steps.stages.items()}

    @property
    def _parts(self) -> dict[str, FeatureSums | ContrastSums | StageSums]:
        contrast = {} if self._contrast is None else {"": self._contrast}
        return {**contrast, **self._ten, **self._stages}

    def add(self, *scans: CleanedScan) -> None:
        """Take in scans, one after the other."""
        for prefix, ten in self._ten.items():
            own = self._gain[prefix] == "own"
            ten.add_all(
                (one.magnitude, _phased(one.own if own else one.coherent), one.pose)
                for one in scans
            )
        for one in scans:
            if self._contrast is not None:
                self._contrast.add(
                    one.magnitude[self._steps.channel(self._steps.recipe.contrast)], one.pose
                )
            if self._stages:
                image = self._steps.labelled(one)
                for stage in self._stages.values():
                    stage.add(image)

    def state(self) -> Arrays:
        """Return what was gathered."""
        states = {name: one.state() for name, one in self._parts.items()}
        return bundle_groups(
            {name: one | {"row": self.rows[one["row"]]} for name, one in states.items()}
        )

    def merge(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Take in what another gathered of other scans, of alarms that are among these."""
        for name, one in self._parts.items():
            theirs = group_of(state, name)
            ours = np.isin(theirs["row"], self.rows)
            theirs = {key: value[ours] for key, value in theirs.items()}
            one.merge(theirs | {"row": np.searchsorted(self.rows, theirs["row"])})

    def table(self) -> pd.DataFrame:
        """Compute ``scans`` and the features of every sub-band; with the other gain only the polarimetric ones.

        Variants have P_psi by the other mean too, such as ``circular.P_psi_F1``.
        """
        tables = [] if self._contrast is None else [self._contrast.table()]
        for prefix, ten in self._ten.items():
            columns = ten.table()
            if prefix in OTHER_GAIN.values():
                columns = columns[
                    [f"{p}_{band}" for band in self._steps.subbands for p in POLARIMETRIC]
                ]
            if len(self._ten) > 1 and prefix != SWAPPED:
                other = OTHER_PSI[ten.settings.psi]
                names = [f"{other}.P_psi_{band}" for band in self._steps.subbands]
                columns = columns.join(pd.DataFrame(ten.psi(other), columns.index, names))
            tables.append(
                (columns.drop(columns="scans") if prefix == SWAPPED else columns).add_prefix(prefix)
            )
        return pd.concat([*tables, *(stage.table() for stage in self._stages.values())], axis=1)


def _phased(image: ComplexArray | None) -> ComplexArray:
    if image is None:
        raise ValueError("scan must be cleaned as its features need it, got one without its phase")
    return image
