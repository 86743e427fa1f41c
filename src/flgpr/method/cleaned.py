"""A run's cleaned images and their background."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import xarray as xr
from numpy.typing import NDArray

from flgpr.clutter import Background
from flgpr.imaging import ScanImager
from flgpr.method.images import RunImages
from flgpr.stages import ComplexArray, FloatArray


class CleanedRun:
    """A run's cleaned images, made anew on every pass, as far ahead as counts.

    Parameters
    ----------
    images : RunImages
        The images before they are cleaned.
    background : mapping of str to ndarray
        The result of the pass "gain".
    """

    def __init__(self, images: RunImages, background: Mapping[str, NDArray[Any]]) -> None:
        self.grid = images.grid
        self._images = images
        #: whether a near image is made of the data of its scan alone, without the pixels beyond
        self.reads_data = images.plain and not images.in_memory
        self.gains: FloatArray = background["gains"]
        arrays = {}
        for name in background:
            if name != "gains":
                arrays[name] = background[name]
        self.whole_background = Background(**arrays)
        self.background: Background = self.whole_background.cropped(self.grid.ny)
        imager = images.imager
        self.imager = ScanImager(
            imager.run, self.grid, imager.subbands, imager.window, imager.tolerance, imager.device
        )

    def __len__(self) -> int:
        return len(self.imager)

    def near_image(self, index: int, data: ComplexArray | None = None) -> xr.DataArray:
        """Return the image of a scan before its background is removed, with its number and pose.

        Parameters
        ----------
        index : int
            Index of the scan among the complete ones.
        data : (polarization, pair, frequency) ndarray of complex, optional
            The scan's data, where they have been read already.
        """
        if self.reads_data:
            return self.imager.image(int(self.imager.scans[index]), data)
        return self._images.scan_image(index).isel(y=slice(self.grid.ny))

    def coherent(self, index: int) -> xr.DataArray:
        """Return the cleaned image of the scan at an index, with its phase.

        It is in units of the background, with a gain of each polarization's own.
        """
        image = self.near_image(index)
        return image.copy(data=self.background.own_coherent(image.values, self.gains[index]))
