"""One scan of a run, as the passes see it."""

from __future__ import annotations

from functools import cached_property

import xarray as xr

from flgpr.method.imaged_run import ImagedRun
from flgpr.method.steps import CleanedImages
from flgpr.types import ComplexArray, Float32Array, FloatArray, floats


class ImagedScan:
    """One scan of a run: its images, made when a pass asks, and shared by passes that go together.

    ``index`` counts among the complete scans. What is cleaned needs the result of the pass "gain".
    """

    def __init__(self, lane: ImagedRun, index: int) -> None:
        self._lane = lane
        self.index = index

    @cached_property
    def data(self) -> ComplexArray | None:
        """The scan's data (polarization, pair, frequency), read once for several uses.

        None unless both the image and what explains alarms are made of them.
        """
        lane = self._lane
        if lane.reads_data_once:
            return lane.imager.signal(int(lane.imager.scans[self.index]))
        return None

    @cached_property
    def near_image(self) -> xr.DataArray:
        """The image before its background is removed, as far ahead as counts, with its pose."""
        lane = self._lane
        return lane.near_image(self.index, self.data if lane.reads_data else None)

    @property
    def gain(self) -> FloatArray:
        """The scan's gain (polarization, subband)."""
        return self._lane.gains[self.index]

    @property
    def number(self) -> int:
        """The scan's number in the run."""
        return int(self.near_image.attrs["scan"])

    @property
    def pose(self) -> FloatArray:
        """The scan's pose (6,) in the lane frame."""
        return floats(self.near_image.attrs["pose"])

    def magnitude(self) -> Float32Array:
        """Return the cleaned magnitude (polarization, subband, y, x), or the recipe's map of it.

        It is in units of the background (Wang et al. 2007, Eq. 5).
        """
        lane = self._lane
        if lane.mapper is None:
            return lane.background.magnitude(self.near_image.values, self.gain)
        return lane.mapper.map(self._coherent)[None, None]

    def map_as_learnt(self) -> Float32Array:
        """Return the map (1, 1, y, x) as it is where nothing stands in for what was learnt."""
        return self._lane.mapper.map_as_learnt(self._coherent)[None, None]

    @property
    def _coherent(self) -> xr.DataArray:
        """The cleaned image with its phase, a gain of each polarization's own."""
        coherent = self._lane.background.own_coherent(self.near_image.values, self.gain)
        return self.near_image.copy(data=coherent)

    @cached_property
    def cleaned(self) -> CleanedImages:
        """The cleaned images, as far as features and explanations read them."""
        lane = self._lane
        return lane.steps.clean(
            self.number,
            self.pose,
            self.near_image.values,
            self.gain,
            lane.background,
            needs_own_phase=lane.explains,
        )
