"""Bright objects beside the lane: found by a mask, fitted with the forward model.

One stage subtracts their response, another says how much of an alarm it explains.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Annotated, Any, ClassVar

import numpy as np
import xarray as xr
from pydantic import Field

from flgpr.clutter import roadside_mask, suppress_by_model
from flgpr.engine import BLOCK, Accumulator, PlannedPass, append_accumulator, block_name, blocks_of
from flgpr.kernels.windows import WINDOWS, band_weights
from flgpr.model import Grid, lane_to_scan
from flgpr.model.bounds import Moderate, Spacing
from flgpr.model.run import polarizations_of
from flgpr.screen import RunViewSums, sample_scan
from flgpr.screen.views import sampled
from flgpr.stages import ClutterStage, FeatureStage, Setup, Table, measured, scan_bytes, scan_number
from flgpr.types import AnyArray, Arrays, ComplexArray, Entries, FloatArray

MASK = "roadside"
"""Name of the pass that finds the mask."""
FIT = "roadside.fit"
"""Name of the pass that fits what lies under it."""
_NEEDS_WHOLE_RUN = "only the whole run shows what outshines the lane"


class RoadsideSettings(Table):
    """The mask and the fit.

    The mask holds the pixels outside the lane that are brighter than every pixel in it, grown a
    little, but never into the lane.
    """

    subband: str  #: sub-band in which pixels are compared
    spacing: Spacing  #: of the model's pixels, m
    grow: Moderate  #: by which the mask is grown, m
    iterations: Annotated[int, Field(ge=1, le=10_000)]  #: number of conjugate gradients


class RoadsideShareSettings(RoadsideSettings):
    """The mask, the fit, and the polarization whose amplitude is divided."""

    polarization: str = "HH"


class RoadsideModel:
    """The response of what outshines the lane.

    Parameters
    ----------
    settings : RoadsideSettings
        The mask and the fit.
    setup : Setup
        The chain of the stage.
    read : callable
        Returns the data (polarization, pair, frequency) of the scan at an index.

    Raises
    ------
    ValueError
        If images do not have the sub-band of the mask.
    """

    def __init__(
        self,
        settings: RoadsideSettings,
        setup: Setup,
        read: Callable[[int], ComplexArray],
    ) -> None:
        known = setup.imager.subbands
        if settings.subband not in known:
            raise ValueError(
                f"roadside.subband must be one of image.subbands ({', '.join(known)}), got "
                f"{settings.subband!r}"
            )
        self.settings = settings
        self.setup = setup
        self.read = read
        if self._farthest_seen() <= setup.lane.y_min:
            raise ValueError(
                f"lane must lie where scans see it, y up to {self._farthest_seen():g} m, got y from "
                f"{setup.lane.y_min:g} m: look at its borders, and at the run's positions"
            )

    def _farthest_seen(self) -> float:
        """Return how far along the lane images reach, m."""
        poses = self.setup.run["pose"].values[self.setup.imager.scans]
        return float(self.setup.imager.grid.y[-1] + poses[:, 1].max())

    def passes(self) -> list[PlannedPass]:
        """Return the pass that finds the mask, and that which fits what lies under it."""
        mask = PlannedPass(MASK, "bright roadside", self._find_mask, all_scans=True)
        fit = PlannedPass(
            FIT, "fit of the roadside", self._fit_scans, (MASK,), all_scans=True, keep_blocks=True
        )
        return [mask, fit]

    @property
    def points(self) -> FloatArray:
        """Points (point, 3) of the mask in the lane frame, m; needs the pass that finds it."""
        return np.asarray(self.setup.results[MASK]["points"])

    def cleaned(self, index: int) -> ComplexArray:
        """Return the data of a scan without the fitted response; needs both passes' results."""
        block = self._block_of(index)
        row = int(np.flatnonzero(block["index"] == index)[0])
        data: ComplexArray = block["data"][row]
        return data

    def image(self, index: int, data: ComplexArray) -> xr.DataArray:
        """Return the image of data of the scan at an index."""
        return self.setup.imager.image(scan_number(self.setup, index), data)

    def notes(self) -> Entries:
        """Return the mask's size and middle, and what its brightest pixel lost.

        Needs the results of both passes.
        """
        points = self.points
        notes: Entries = {"mask_pixels": len(points)}
        if len(points):
            before = 0.0
            after = 0.0
            for number in range(len(blocks_of(len(self.setup.imager)))):
                block = self.setup.results[block_name(FIT, number)]
                before = max(before, float(block["before"].max()))
                after = max(after, float(block["after"].max()))
            notes["mask_centre"] = [round(float(value), 3) for value in points[:, :2].mean(axis=0)]
            notes["mask_peak_reduced_by_db"] = round(20 * float(np.log10(before / after)), 1)
        return notes

    def _find_mask(self, block: range | None) -> Accumulator:  # noqa: ARG002
        """Return what finds the mask.

        The power of all polarizations is laid on the lane and the ground beside it.
        """
        settings = self.settings
        setup = self.setup
        pixels = setup.imager.grid
        lane = setup.lane
        poses = setup.run["pose"].values[setup.imager.scans]
        # As wide as any scan sees, for a vehicle that heads along the lane.
        left = pixels.x_min + poses[:, 0].min()
        right = pixels.x[-1] + poses[:, 0].max()
        farthest = min(lane.y_max, self._farthest_seen())
        grid = Grid.spanning((left, right), (lane.y_min, farthest), settings.spacing)
        sums = RunViewSums(grid, np.inf)

        def add(index: int) -> None:
            image = self.image(index, self.read(index)).isel(polarization=setup.imaged)
            values = image.sel(subband=[settings.subband]).values
            power = np.mean(np.abs(values) ** 2, axis=0, keepdims=True)
            sums.add(np.sqrt(power), pixels, np.asarray(image.attrs["pose"]))

        def result() -> Arrays:
            inside = lane.contains(*np.meshgrid(grid.x, grid.y))
            brightness = sums.result()[0][0, 0]
            mask = roadside_mask(brightness, inside, round(settings.grow / settings.spacing))
            return {"points": grid.points()[mask]}

        return Accumulator(add, lambda _: sums.state(), sums.merge, result)

    def _fit_scans(self, block: range | None) -> Accumulator:  # noqa: ARG002
        """Return what fits every scan.

        It gathers the data without the fitted response, and the magnitude of the mask's brightest
        pixel before and after.
        """
        pieces: list[Arrays] = []

        def add(index: int) -> None:
            data = self.read(index)
            cleaned = self._subtract(index, data)
            pieces.append(
                {
                    "index": np.array([index]),
                    "data": cleaned[None],
                    "before": np.array([self._peak(index, data)]),
                    "after": np.array([self._peak(index, cleaned)]),
                }
            )

        return append_accumulator(pieces, add)

    def _subtract(self, index: int, data: ComplexArray) -> ComplexArray:
        """Return the data of a scan without the fitted response of what lies under the mask."""
        setup = self.setup
        if not len(self.points):
            return data
        tones = np.asarray(setup.run["frequency"].values)
        band = setup.imager.subbands[self.settings.subband]
        weight = band_weights(tones, (band,), WINDOWS["hann"])[0]
        points = lane_to_scan(self.points, setup.pose(index))
        operator = setup.imager.operator_on(scan_number(setup, index), points)
        return suppress_by_model(data, operator, self.settings.iterations, weight).data

    def _peak(self, index: int, data: ComplexArray) -> float:
        """Return the largest magnitude of a scan's image under the mask."""
        if not len(self.points):
            return 0.0
        image = self.image(index, data).isel(polarization=self.setup.imaged)
        points = lane_to_scan(self.points, self.setup.pose(index))
        values = sample_scan(image.sel(subband=self.settings.subband), points)
        return float(np.nanmax(values, initial=0.0))

    def _block_of(self, index: int) -> Mapping[str, AnyArray]:
        """Return what the fit has gathered of the block that holds an index."""
        for number, block in enumerate(blocks_of(len(self.setup.imager))):
            if index in block:
                stored: Mapping[str, AnyArray] = self.setup.results[block_name(FIT, number)]
                return stored
        raise ValueError(f"index must be one of {len(self.setup.imager)} scans, got {index}")


class RoadsideSuppression(ClutterStage):
    """Subtracts the modelled response of what outshines the lane from beside it."""

    not_live_because = _NEEDS_WHOLE_RUN
    Settings: ClassVar[type[Table]] = RoadsideSettings

    def __init__(self, settings: Any, setup: Any, learnt: Arrays | None = None) -> None:
        super().__init__(settings, setup, learnt)
        self.model = RoadsideModel(settings, setup, self._data_before)

    @classmethod
    def memory(cls, settings: Any, sizes: Mapping[str, int], image: Grid) -> float:  # noqa: ARG003
        """Estimate the bytes of a block's cleaned data and of the images before and after."""
        return _memory(sizes, image)

    def passes(self) -> list[PlannedPass]:
        """Find the mask and fit what lies under it."""
        return self.model.passes()

    def clean(self, index: int, data: ComplexArray) -> ComplexArray:  # noqa: ARG002
        """Return the data without the fitted response."""
        return self.model.cleaned(index)

    def notes(self) -> Entries:
        """Return the size of the mask and what its brightest pixel lost."""
        return self.model.notes()


class RoadsideShare(FeatureStage):
    """The column ``roadside``: the share of an alarm's amplitude that the roadside explains.

    It is |before - after| / |before|, the image values at the alarm before and after the modelled
    response is subtracted, mean over the scans that see it. It may exceed 1.
    """

    not_live_because = _NEEDS_WHOLE_RUN
    Settings: ClassVar[type[Table]] = RoadsideShareSettings
    columns = ("roadside",)
    alarm_columns = ("roadside",)

    def __init__(self, settings: Any, setup: Any, learnt: Arrays | None = None) -> None:
        super().__init__(settings, setup, learnt)
        labels = polarizations_of(setup.run)
        if settings.polarization not in labels:
            raise ValueError(
                f"roadside.polarization must be one of {', '.join(labels)}, got "
                f"{settings.polarization!r}"
            )
        self.model = RoadsideModel(settings, setup, partial(measured, setup))

    @classmethod
    def memory(cls, settings: Any, sizes: Mapping[str, int], image: Grid) -> float:  # noqa: ARG003
        """Estimate the bytes of a block's cleaned data and of the images before and after."""
        return _memory(sizes, image)

    def passes(self) -> list[PlannedPass]:
        """Find the mask and fit what lies under it."""
        return self.model.passes()

    def notes(self) -> Entries:
        """Return the size of the mask and what its brightest pixel lost."""
        return self.model.notes()

    def of_image(self, image: xr.DataArray, points: FloatArray) -> Mapping[str, FloatArray]:
        """Return the share of every alarm; NaN where the scan does not see it."""
        index = int(np.flatnonzero(self.setup.imager.scans == image.attrs["scan"])[0])
        channel = {"polarization": self.settings.polarization, "subband": self.settings.subband}
        data = measured(self.setup, index)
        before = self.model.image(index, data).sel(channel).values
        after = self.model.image(index, self.model.cleaned(index)).sel(channel).values
        values = np.stack([before, before - after])
        total, explained = np.abs(sampled(values, self.setup.imager.grid, points))
        return {"roadside": explained / np.maximum(total, np.finfo(np.float64).tiny)}


def _memory(sizes: Mapping[str, int], image: Grid) -> float:
    """Estimate the bytes of a block's cleaned data and of the images before and after."""
    return 2 * BLOCK * scan_bytes(sizes) + 4 * 8.0 * sizes["polarization"] * image.nx * image.ny
