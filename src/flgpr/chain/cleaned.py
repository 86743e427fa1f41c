"""A run's cleaned images, and one scan of a lane as the passes see it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from flgpr.chain.alarm_features import CleanedScan
from flgpr.chain.images import RunImages
from flgpr.chain.stages import ComplexArray, FloatArray
from flgpr.clutter import Background
from flgpr.imaging import ScanImager

if TYPE_CHECKING:
    from flgpr.chain.lane_setup import LaneSetup


class CleanedRun:
    """A run's cleaned images, made anew on every pass, as far ahead as counts, and their background.

    ``background`` is the result of the pass "gain"; ``whole_image`` returns whole images where these are in memory.
    """

    def __init__(
        self,
        images: RunImages,
        background: Mapping[str, NDArray[Any]],
        whole_image: Callable[[int], xr.DataArray] | None = None,
    ) -> None:
        self.grid = images.grid
        self._whole_image = whole_image if images.plain else images.image
        self.gains: FloatArray = background["gains"]
        arrays = {name: background[name] for name in background if name != "gains"}
        self.whole_background = Background(**arrays)
        self.background: Background = self.whole_background.cropped(self.grid.ny)
        imager = images.imager
        self.imager = ScanImager(
            imager.run, self.grid, imager.subbands, imager.window, imager.tolerance, imager.device
        )

    def __len__(self) -> int:
        return len(self.imager)

    @property
    def reads_data(self) -> bool:
        """Whether an image is made of the data of its scan alone."""
        return self._whole_image is None

    def scan(self, index: int, data: ComplexArray | None = None) -> xr.DataArray:
        """Return the image of the scan at an index among the complete ones, with its ``pose`` and number.

        ``data`` are those of the scan, where they have been read already.
        """
        if self._whole_image is not None:
            return self._whole_image(index).isel(y=slice(self.grid.ny))
        return self.imager.image(int(self.imager.scans[index]), data)

    def coherent(self, index: int) -> xr.DataArray:
        """Return the cleaned image of the scan at an index, in units of its background, with its phase."""
        image = self.scan(index)
        return image.copy(data=self.background.own_coherent(image.values, self.gains[index]))


class LaneScan:
    """One scan of a lane, as passes see it: its images, made when a pass asks, and shared by passes that go together.

    ``index`` counts among the complete scans. What is cleaned needs the result of the pass "gain".
    """

    def __init__(self, lane: LaneSetup, index: int) -> None:
        self._lane = lane
        self.index = index

    def raw_image(self, rows: int | None = None) -> NDArray[np.complex64]:
        """Return the image (polarization, subband, y, x) before its background is removed, at least ``rows`` of it."""
        values: NDArray[np.complex64] = self._lane.image(self.index, rows).values
        return values

    @cached_property
    def data(self) -> ComplexArray | None:
        """The scan's data (polarization, pair, frequency), where the image and what explains alarms share them."""
        lane = self._lane
        if lane.reads_data_once:
            return lane.imager.signal(int(lane.imager.scans[self.index]))
        return None

    @cached_property
    def image(self) -> xr.DataArray:
        """The image as far ahead as counts, before its background is removed, with its number and pose."""
        cleaned = self._lane.cleaned
        return cleaned.scan(self.index, self.data if cleaned.reads_data else None)

    @property
    def gain(self) -> FloatArray:
        """The scan's gain (polarization, subband)."""
        return self._lane.cleaned.gains[self.index]

    @property
    def number(self) -> int:
        """The scan's number in the run."""
        return int(self.image.attrs["scan"])

    @property
    def pose(self) -> FloatArray:
        """The scan's pose (6,) in the lane frame."""
        return np.asarray(self.image.attrs["pose"], dtype=np.float64)

    def magnitude(self) -> NDArray[np.float32]:
        """Return the magnitude (polarization, subband, y, x) in units of the background, or the recipe's map of it."""
        lane = self._lane
        background = lane.cleaned.background
        if lane.mapper is None:
            return background.magnitude(self.image.values, self.gain)
        coherent = background.own_coherent(self.image.values, self.gain)
        return lane.mapper.map(self.image.copy(data=coherent))[None, None]

    @cached_property
    def cleaned(self) -> CleanedScan:
        """The images in units of their background, as far as features and explanations read them."""
        lane = self._lane
        return lane.reader.clean(
            self.number,
            self.pose,
            self.image.values,
            self.gain,
            lane.cleaned.background,
            own=lane.explains,
        )
