"""The roadside that a variant suppresses: where it outshines the lane, data without it, and its share of the alarms."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

from flgpr.chain.passes import Accumulator, Arrays, added
from flgpr.chain.recipe import Recipe
from flgpr.clutter import roadside_mask, suppress_by_model
from flgpr.imaging import ScanImager
from flgpr.kernels.sampling import bilinear
from flgpr.kernels.windows import WINDOWS, band_weights
from flgpr.model import Grid, Lane, ground_points, lane_to_scan
from flgpr.screen import RunViewSums, sample_scan

Image = Callable[[int, bool], xr.DataArray]
"""Whole image of the scan at an index, without the roadside if wanted."""


class Roadside:
    """Passes "roadside" and "share" of a recipe with the table suppression; results are looked up in ``known``."""

    def __init__(
        self, recipe: Recipe, imager: ScanImager, lane: Lane, known: Mapping[str, Any]
    ) -> None:
        if recipe.suppression is None:
            raise ValueError("a variant with suppress_roadside needs the table suppression")
        self.table = recipe.suppression
        self.channel = recipe.prescreen
        self.imager = imager
        self.lane = lane
        self._known = known
        self._poses: NDArray[np.float64] = imager.run["pose"].values

    @property
    def points(self) -> NDArray[np.float64]:
        """Places (point, 3) of the mask in the lane frame, m; needs the pass "roadside"."""
        return np.asarray(self._known["roadside"]["points"])

    def find(self, image: Image) -> Accumulator:
        """Find the ground beside the lane that outshines everything in it."""
        table = self.table
        pixels = self.imager.grid
        lane = self.lane
        poses = self._poses[self.imager.scans]
        x = pixels.x_min + poses[:, 0].min(), pixels.x[-1] + poses[:, 0].max()
        far = min(lane.y_max, pixels.y[-1] + poses[:, 1].max())
        grid = Grid.spanning(x, (lane.y_min, far), table.spacing)
        sums = RunViewSums(grid, np.inf)

        def add(index: int) -> None:
            whole = image(index, False)
            power = np.mean(
                np.abs(whole.sel(subband=[table.subband]).values) ** 2, axis=0, keepdims=True
            )
            sums.add(np.sqrt(power), pixels, np.asarray(whole.attrs["pose"]))

        def result() -> Arrays:
            inside = lane.contains(*np.meshgrid(grid.x, grid.y))
            mask = roadside_mask(sums.result()[0][0, 0], inside, round(table.grow / table.spacing))
            return {"points": grid.points()[mask]}

        return Accumulator(add, lambda _: sums.state(), sums.merge, result)

    def cleaned(self, scan: int) -> NDArray[np.complex64] | None:
        """Give the data of a scan without what the mask holds; None where it is empty."""
        table = self.table
        imager = self.imager
        if not len(self.points):
            return None
        tones = np.asarray(imager.run["frequency"].values)
        weight = band_weights(tones, (imager.subbands[table.subband],), WINDOWS["hann"])[0]
        operator = imager.operator_on(scan, lane_to_scan(self.points, self._poses[scan]))
        return suppress_by_model(imager.signal(scan), operator, table.iterations, weight).data

    def share(self, alarms: pd.DataFrame, image: Image) -> Accumulator:
        """Tell what part of the alarms' amplitude, and of the brightest pixel in the mask, the roadside's model is."""
        grid = self.imager.grid
        points = self.points
        centres = ground_points(alarms)
        channel = {"polarization": self.channel.polarization, "subband": self.channel.subband}
        power = {name: np.zeros(len(alarms)) for name in ("total", "modelled")}
        peaks = np.zeros(2)

        def add(index: int) -> None:
            both = [image(index, suppressed) for suppressed in (False, True)]
            pose = np.asarray(both[0].attrs["pose"])
            local = lane_to_scan(centres, pose)
            where = (local[:, 1] - grid.y_min) / grid.dy, (local[:, 0] - grid.x_min) / grid.dx
            before, after = (bilinear(one.sel(channel).values, *where) for one in both)
            power["total"] += np.nan_to_num(np.abs(before) ** 2)
            power["modelled"] += np.nan_to_num(np.abs(before - after) ** 2)
            for k, one in enumerate(both if len(points) else ()):
                values = sample_scan(
                    one.sel(subband=self.table.subband), lane_to_scan(points, pose)
                )
                peaks[k] = max(peaks[k], float(np.nanmax(values, initial=0.0)))

        sums = added(power, add)

        def merge(state: Mapping[str, NDArray[Any]]) -> None:
            sums.merge(state)
            np.maximum(peaks, state["peaks"], out=peaks)

        return Accumulator(
            add, lambda _: power | {"peaks": peaks}, merge, lambda: power | {"peaks": peaks}
        )

    def notes(self) -> dict[str, Any]:
        """Tell the mask's size, middle and what its brightest pixel lost; needs both passes."""
        points = self.points
        peaks = self._known["share"]["peaks"]
        notes: dict[str, Any] = {"mask_pixels": len(points)}
        if len(points):
            notes["mask_centre"] = [round(float(value), 3) for value in points[:, :2].mean(axis=0)]
            notes["mask_peak_reduced_by_db"] = round(20 * float(np.log10(peaks[0] / peaks[1])), 1)
        return notes
