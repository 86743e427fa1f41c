"""Features of alarms gathered scan by scan, in stored runs, their sections, and live."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

import numpy as np
import pandas as pd

from flgpr.engine import bundle_groups, group_of
from flgpr.features import FEATURES, POLARIMETRIC, ContrastSums, FeatureSettings, FeatureSums
from flgpr.method.memory import column_count
from flgpr.method.steps import CleanedImages, Steps
from flgpr.model import Grid
from flgpr.recipe.schema import Recipe
from flgpr.recipe.tables import FeaturesTable
from flgpr.stages.sums import AlarmGatherer
from flgpr.store.tables import MOST_COLUMNS
from flgpr.types import AnyArray, Arrays, ComplexArray, IndexArray

SWAPPED = "swapped."
"""Prefix of the columns of a variant: the regions of patches are exchanged."""
OTHER_GAIN = {"shared": "paper.", "own": "shared."}
"""Prefix of the polarimetric features with the other gain, by the recipe's gain.

``paper.`` are those with a gain of each polarization's own.
"""
OTHER_PSI: dict[str, Literal["circular", "linear"]] = {"circular": "linear", "linear": "circular"}
"""The other mean of ψ, whose name stands before P_psi in the columns of variants."""
_PSI_OF_GAIN: dict[str, Literal["circular", "linear"]] = {"shared": "circular", "own": "linear"}
_FEW_COLUMNS = 64
"""Columns of a table of features that are left for stages of few columns, which are not counted."""


def own_column_count(recipe: Recipe) -> int:
    """Return how many columns of a table of features belong to no stage.

    Parameters
    ----------
    recipe : Recipe
        The recipe.

    Returns
    -------
    int
        The number of scans with the contrast and the magnitude, or with the ten features of every
        sub-band and their variants, see :meth:`AlarmSums.table`.
    """
    table = recipe.features
    if table is None:
        return 3  # scans, contrast, magnitude
    per_band = len(FEATURES)
    if table.variants:
        swapped = len(FEATURES)
        with_other_gain = len(POLARIMETRIC)
        with_other_mean = 2  # P_psi with either gain
        per_band += swapped + with_other_gain + with_other_mean
    return 1 + per_band * len(recipe.image.subbands)


def check_column_count(recipe: Recipe, polarizations: int, view: Grid) -> None:
    """Refuse stages that have more columns than the table of features can be read with.

    Parameters
    ----------
    recipe : Recipe
        The recipe.
    polarizations : int
        Polarizations of the images.
    view : Grid
        Pixels of the run-view.

    Raises
    ------
    ValueError
        If they have more; it says how many they may have.
    """
    most = MOST_COLUMNS - own_column_count(recipe) - _FEW_COLUMNS
    count = column_count(polarizations, recipe, view)
    if count > most:
        raise ValueError(
            f"columns of the recipe {recipe.name} must be at most {most}, got "
            f"{count}: take a smaller patch, coarser cells or fewer polarizations"
        )


class AlarmSums:
    """Features of alarms, gathered scan by scan.

    Parameters
    ----------
    steps : Steps
        The recipe's steps.
    alarms : DataFrame
        ``x``, ``y`` in the lane frame, m.
    rows : (alarm,) ndarray of int, optional
        Their numbers among all alarms, ascending.
    """

    def __init__(self, steps: Steps, alarms: pd.DataFrame, rows: IndexArray | None = None) -> None:
        self._steps = steps
        self.rows = np.arange(len(alarms)) if rows is None else rows
        recipe = steps.recipe
        self._contrast: ContrastSums | None = None
        self._ten: dict[str, FeatureSums] = {}  # the ten features, by the prefix of their columns
        self._gain: dict[str, str] = {}  # "shared" or "own", by the same prefix
        if recipe.features is None:
            patch = recipe.contrast.patch()
            self._contrast = ContrastSums(alarms, steps.grid, recipe.run_view.y_max, patch)
        else:
            self._begin_ten_features(alarms, recipe.features)
        self._stages: dict[str, AlarmGatherer] = {}
        for name, stage in steps.stages.items():
            self._stages[name] = stage.sums(alarms)

    def _begin_ten_features(self, alarms: pd.DataFrame, table: FeaturesTable) -> None:
        """Make the sums of the ten features, and of their variants where the recipe has them."""
        steps = self._steps
        recipe = steps.recipe
        patch = recipe.contrast.patch()
        y_max = recipe.run_view.y_max
        main = FeatureSettings(patch, table.inner, y_max, table.psi, steps.polarimetric)
        settings = {"": main}
        self._gain = {"": table.gain, SWAPPED: table.gain}
        if table.variants:
            other_gain = "own" if table.gain == "shared" else "shared"
            prefix = OTHER_GAIN[table.gain]
            self._gain[prefix] = other_gain
            settings[SWAPPED] = main.swapped()
            psi = _PSI_OF_GAIN[other_gain]
            settings[prefix] = FeatureSettings(patch, main.inner, main.y_max, psi)
        for prefix, variant in settings.items():
            self._ten[prefix] = FeatureSums(
                alarms, steps.polarizations, steps.subbands, steps.grid, variant
            )

    @property
    def _sums(self) -> dict[str, FeatureSums | ContrastSums | AlarmGatherer]:
        """All sums by the names of their groups in a state."""
        contrast = {} if self._contrast is None else {"": self._contrast}
        return {**contrast, **self._ten, **self._stages}

    def add(self, *scans: CleanedImages) -> None:
        """Add scans, one after the other."""
        for prefix, ten in self._ten.items():
            own_gain = self._gain[prefix] == "own"
            images = []
            for scan in scans:
                images.append((scan.magnitude, _phased(scan, own_gain=own_gain), scan.pose))
            ten.add_all(images)
        for scan in scans:
            if self._contrast is not None:
                channel = self._steps.channel(self._steps.recipe.contrast)
                self._contrast.add(scan.magnitude[channel], scan.pose)
            if self._stages:
                image = self._steps.labelled(scan)
                for stage in self._stages.values():
                    stage.add(image)

    def state(self) -> Arrays:
        """Return all sums, with the numbers of their alarms among all."""
        groups = {}
        for name, sums in self._sums.items():
            state = sums.state()
            groups[name] = state | {"row": self.rows[state["row"]]}
        return bundle_groups(groups)

    def merge(self, state: Mapping[str, AnyArray]) -> None:
        """Add the sums of other scans; alarms that are not among these are left out."""
        for name, sums in self._sums.items():
            other_sums = group_of(state, name)
            known = np.isin(other_sums["row"], self.rows)
            of_these = {key: value[known] for key, value in other_sums.items()}
            # Numbers among all alarms become rows of these.
            of_these["row"] = np.searchsorted(self.rows, of_these["row"])
            sums.merge(of_these)

    def table(self) -> pd.DataFrame:
        """Return ``scans`` and the features of every sub-band.

        With the other gain there are only the polarimetric ones. Recipes with variants have P_psi
        by the other mean too, such as ``circular.P_psi_F1``.
        """
        tables = [] if self._contrast is None else [self._contrast.table()]
        for prefix, ten in self._ten.items():
            tables.append(self._table_of(prefix, ten))
        for stage in self._stages.values():
            tables.append(stage.table())
        return pd.concat(tables, axis=1)

    def _table_of(self, prefix: str, ten: FeatureSums) -> pd.DataFrame:
        """Return the columns of the ten features, or of one of their variants."""
        columns = ten.table()
        subbands = self._steps.subbands
        if prefix in OTHER_GAIN.values():
            names = []
            for band in subbands:
                names += [f"{feature}_{band}" for feature in POLARIMETRIC]
            columns = columns[names]
        has_variants = len(self._ten) > 1
        if has_variants and prefix != SWAPPED:
            other_mean = OTHER_PSI[ten.settings.psi]
            names = [f"{other_mean}.P_psi_{band}" for band in subbands]
            columns = columns.join(pd.DataFrame(ten.psi(other_mean), columns.index, names))
        if prefix == SWAPPED:
            columns = columns.drop(columns="scans")
        return columns.add_prefix(prefix)


def _phased(scan: CleanedImages, own_gain: bool) -> ComplexArray:
    """Return the images with their phase, of one of the two gains."""
    image = scan.own if own_gain else scan.coherent
    if image is None:
        raise ValueError("scan must be cleaned as its features need it, got one without its phase")
    return image
