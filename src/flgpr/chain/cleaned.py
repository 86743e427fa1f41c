"""A run's cleaned images and their background."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import xarray as xr
from numpy.typing import NDArray

from flgpr.chain.images import RunImages
from flgpr.chain.stages import ComplexArray, FloatArray
from flgpr.clutter import Background
from flgpr.imaging import ScanImager


class CleanedRun:
    """A run's cleaned images, made anew on every pass, as far ahead as counts.

    Parameters
    ----------
    images : RunImages
        The images before they are cleaned.
    background : mapping of str to ndarray
        The result of the pass "gain".
    whole_image : callable, optional
        Returns the whole image of the scan at an index, where images stay in memory.
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

    @property
    def reads_data(self) -> bool:
        """Whether an image is made of the data of its scan alone."""
        return self._whole_image is None

    def scan(self, index: int, data: ComplexArray | None = None) -> xr.DataArray:
        """Return the image of a scan before its background is removed, with its number and pose.

        Parameters
        ----------
        index : int
            Index of the scan among the complete ones.
        data : (polarization, pair, frequency) ndarray of complex, optional
            The scan's data, where they have been read already.
        """
        if self._whole_image is not None:
            return self._whole_image(index).isel(y=slice(self.grid.ny))
        return self.imager.image(int(self.imager.scans[index]), data)

    def coherent(self, index: int) -> xr.DataArray:
        """Return the cleaned image of the scan at an index, with its phase.

        It is in units of the background, with a gain of each polarization's own.
        """
        image = self.scan(index)
        return image.copy(data=self.background.own_coherent(image.values, self.gains[index]))
