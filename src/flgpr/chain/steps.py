"""The steps of the method that detection on stored runs and live detection take alike.

What differs is what is known: of a stored run the background and the run-view of all scans, live
those of the scans so far.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

from flgpr.chain.model import Detector
from flgpr.chain.recipe import RANKS, ContrastTable, PrescreenTable, Recipe
from flgpr.chain.stages import ComplexArray, FeatureStage, FloatArray
from flgpr.clutter import Background
from flgpr.imaging.scan import blank_image
from flgpr.model import Grid
from flgpr.screen import MeanViewSums, RangeViewSums, RunViewSums, local_maxima


@dataclass(frozen=True)
class CleanedScan:
    """A scan's images (polarization, subband, y, x) in units of their background, as far ahead as counts.

    The polarizations of ``coherent`` share one gain, those of ``own`` have their own; None where
    nothing reads them.
    """

    number: int
    pose: FloatArray
    magnitude: NDArray[np.float32]
    coherent: ComplexArray | None = None
    own: ComplexArray | None = None


@dataclass(frozen=True)
class Steps:
    """The steps of a recipe on images of some channels, whose pixels that count are ``grid``.

    ``stages`` are the feature stages that read images, by name; ``detector`` scores the alarms, by
    default their local contrast does.
    """

    recipe: Recipe
    polarizations: Sequence[str]
    subbands: Sequence[str]
    grid: Grid
    stages: Mapping[str, FeatureStage]
    #: sub-bands whose polarimetric features are read; None reads all
    polarimetric: tuple[str, ...] | None = None
    detector: Detector | None = None

    def channel(self, table: ContrastTable | PrescreenTable) -> tuple[int, int]:
        """Return where the polarization and sub-band of a table stand in the images."""
        polarization = list(self.polarizations).index(table.polarization)
        subband = list(self.subbands).index(table.subband)
        return polarization, subband

    def clean(
        self,
        number: int,
        pose: FloatArray,
        image: ComplexArray,
        gain: FloatArray,
        background: Background,
        own: bool = False,
    ) -> CleanedScan:
        """Remove the background from a scan's image (Eq. 2 to 4), as far as its features need it.

        ``own`` asks for the phase with a gain of each polarization's own even where no feature
        reads it.
        """
        table = self.recipe.features
        rows = self.grid.ny
        shared = table is not None and (table.gain == "shared" or table.variants)
        if self.stages or (table is not None and (table.gain == "own" or table.variants)):
            own = True
        return CleanedScan(
            number,
            pose,
            background.magnitude(image, gain, rows),
            background.coherent(image, gain, rows) if shared else None,
            background.own_coherent(image, gain, rows) if own else None,
        )

    def labelled(self, scan: CleanedScan) -> xr.DataArray:
        """Return the image whose channels have their own gain with its names, axes, number and pose."""
        image = self._blank.copy(deep=False, data=scan.own)
        image.attrs = {"scan": scan.number, "pose": scan.pose.tolist()}
        return image

    @cached_property
    def _blank(self) -> xr.DataArray:
        return blank_image(list(self.polarizations), list(self.subbands), self.grid.y, self.grid.x)

    @property
    def single(self) -> str:
        """Name of the column that is the confidence where nothing was trained."""
        table = self.recipe.contrast
        if self.recipe.confidence != "contrast" or self.recipe.features is None:
            return self.recipe.confidence
        return f"C_{table.polarization}_{table.subband}"

    def view_sums(
        self, grid: Grid, rows: slice | None = None
    ) -> RunViewSums | MeanViewSums | RangeViewSums:
        """Make the sums of the recipe's look (Sec. II-B), on rows of a grid of the lane frame."""
        table = self.recipe.run_view
        if table.look == "ranges":
            return RangeViewSums(grid, table.y_max, rows, table.ranges, table.within)
        if table.look == "mean":
            return MeanViewSums(grid, table.y_max, rows, table.falloff)
        return RunViewSums(grid, table.y_max, rows)

    def maxima(self, view: xr.DataArray) -> pd.DataFrame:
        """Find the local maxima of one channel of a run-view (y, x): x, y (m) and magnitude (Sec. II-B)."""
        return local_maxima(view, self.recipe.prescreen.radius)

    def confidence(self, features: pd.DataFrame, magnitude: pd.Series[float]) -> Any:
        """Score alarms by their features and magnitude; NaN where one that is read is missing."""
        table = features.assign(magnitude=magnitude)
        if self.detector is None:
            return table[self.single]
        return self.detector.confidence(table)


def check_confidence(recipe: Recipe, columns: Iterable[str]) -> None:
    """Refuse a recipe whose confidence is none of the columns that its stages make."""
    known = [*RANKS, *columns]
    if recipe.confidence not in known:
        raise ValueError(f"confidence must be one of {', '.join(known)}, got {recipe.confidence!r}")
