"""The steps of the method that detection on stored runs and live detection take alike.

What differs is what is known: of a stored run the background and the run-view of all scans, live
those of the scans so far.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, assert_never

import pandas as pd
import xarray as xr

from flgpr.clutter import Background
from flgpr.imaging.scan import blank_image
from flgpr.method.model import Detector
from flgpr.model import Grid
from flgpr.recipe.schema import RANKS, Recipe
from flgpr.recipe.tables import ContrastTable, PrescreenTable
from flgpr.screen import MeanViewSums, RangeViewSums, RunViewSums, local_maxima
from flgpr.stages import FeatureStage
from flgpr.types import ComplexArray, Float32Array, FloatArray


@dataclass(frozen=True)
class CleanedImages:
    """A scan's images (polarization, subband, y, x), cleaned, as far ahead as counts.

    They are in units of their background.
    """

    number: int  #: the scan's number in the run
    pose: FloatArray  #: (6,) in the lane frame
    magnitude: Float32Array
    #: with the phase and one gain that the polarizations share; None where nothing reads it
    coherent: ComplexArray | None = None
    #: with the phase and a gain of each polarization's own; None where nothing reads it
    own: ComplexArray | None = None


@dataclass(frozen=True)
class Steps:
    """The steps of a recipe on images of some channels."""

    recipe: Recipe
    polarizations: Sequence[str]
    subbands: Sequence[str]
    grid: Grid  #: the pixels that count, in the scan frame
    stages: Mapping[str, FeatureStage]  #: the feature stages that read images, by name
    #: sub-bands whose polarimetric features are read; None reads all
    polarimetric: tuple[str, ...] | None = None
    #: scores the alarms; without one their local contrast is the confidence
    detector: Detector | None = None

    def channel(self, table: ContrastTable | PrescreenTable) -> tuple[int, int]:
        """Return the indices of a table's polarization and sub-band in the images."""
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
        needs_own_phase: bool = False,
    ) -> CleanedImages:
        """Remove the background from a scan's image (Wang et al. 2007, Eq. 2 to 5).

        Parameters
        ----------
        number : int
            The scan's number in the run.
        pose : (6,) ndarray
            The scan's pose in the lane frame.
        image : (polarization, subband, y, x) ndarray of complex
            The image, at least the rows of the pixels that count.
        gain : (polarization, subband) ndarray
            The scan's gain.
        background : Background
            Self-signature and gain background.
        needs_own_phase : bool
            Asks for the phase with a gain of each polarization's own even where no feature reads
            it.

        Returns
        -------
        CleanedImages
            The magnitude, and the phases that the recipe's features read.
        """
        rows = self.grid.ny
        table = self.recipe.features
        needs_shared = False
        needs_own = needs_own_phase or bool(self.stages)
        if table is not None:
            needs_shared = table.gain == "shared" or table.variants
            needs_own = needs_own or table.gain == "own" or table.variants

        magnitude = background.magnitude(image, gain, rows)
        shared_phase = background.coherent(image, gain, rows) if needs_shared else None
        own_phase = background.own_coherent(image, gain, rows) if needs_own else None
        return CleanedImages(number, pose, magnitude, shared_phase, own_phase)

    def labelled(self, scan: CleanedImages) -> xr.DataArray:
        """Return the image with each polarization's own gain, with its labels, axes and pose."""
        image = self._blank.copy(deep=False, data=scan.own)
        image.attrs |= {"scan": scan.number, "pose": scan.pose.tolist()}
        return image

    # The axes are made once: the viewer's explanations and the stages ask for every scan.
    @cached_property
    def _blank(self) -> xr.DataArray:
        return blank_image(list(self.polarizations), list(self.subbands), self.grid.y, self.grid.x)

    @property
    def single(self) -> str:
        """Name of the column that is the confidence where no detector was trained."""
        table = self.recipe.contrast
        if self.recipe.confidence != "contrast" or self.recipe.features is None:
            return self.recipe.confidence
        return f"C_{table.polarization}_{table.subband}"

    def view_sums(
        self, grid: Grid, rows: slice | None = None
    ) -> RunViewSums | MeanViewSums | RangeViewSums:
        """Return the empty sums of the recipe's look, such as the second largest (Sec. II-B).

        The roadside's mask and the view before the background is removed take the second largest
        look whatever the recipe says.

        Parameters
        ----------
        grid : Grid
            Pixels of the run-view, in the lane frame.
        rows : slice, optional
            Rows of the grid to sum on; by default all.

        Returns
        -------
        RunViewSums, MeanViewSums or RangeViewSums
            What the images of scans are added to.
        """
        table = self.recipe.run_view
        if table.look == "ranges":
            return RangeViewSums(grid, table.y_max, rows, table.ranges, table.within)
        if table.look == "mean":
            return MeanViewSums(grid, table.y_max, rows, table.falloff)
        if table.look == "second-largest":
            return RunViewSums(grid, table.y_max, rows)
        assert_never(table.look)

    def maxima(self, view: xr.DataArray) -> pd.DataFrame:
        """Find the local maxima of one channel of a run-view (Wang et al. 2007, Sec. II-B).

        Parameters
        ----------
        view : (y, x) DataArray
            One channel of a run-view.

        Returns
        -------
        DataFrame
            ``x``, ``y`` (m, lane frame) and ``magnitude``.
        """
        return local_maxima(view, self.recipe.prescreen.radius)

    def confidence(self, features: pd.DataFrame, magnitude: pd.Series[float]) -> Any:
        """Score alarms by their features and magnitude.

        Parameters
        ----------
        features : DataFrame
            A row per alarm.
        magnitude : Series
            Their magnitudes in the run-view.

        Returns
        -------
        (alarm,) array_like
            The confidence, higher for what is more like a mine; NaN where a feature that is read is
            missing.
        """
        table = features.assign(magnitude=magnitude)
        if self.detector is None:
            return table[self.single]
        return self.detector.confidence(table)


def check_confidence(recipe: Recipe, columns: Iterable[str]) -> None:
    """Refuse a recipe whose confidence is none of the columns that its stages add."""
    known = [*RANKS, *columns]
    if recipe.confidence not in known:
        raise ValueError(f"confidence must be one of {', '.join(known)}, got {recipe.confidence!r}")
