"""A run's images as a recipe wants them.

Clutter stages clean the data, the last scans are summed coherently, and only the polarizations that
the recipe names are imaged.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr

from flgpr.engine import PlannedPass
from flgpr.imaging import ScanImager
from flgpr.method.memory import CACHE
from flgpr.method.model import Model
from flgpr.model import Lane, lane_to_scan, scan_to_lane
from flgpr.recipe.schema import Recipe
from flgpr.recipe.tables import ImageTable
from flgpr.stages import ComplexArray, Setup, make_clutter_stages


def imager_of(
    run: xr.Dataset,
    table: ImageTable,
    subbands: Sequence[str] = (),
    polarizations: Sequence[str] = (),
) -> ScanImager:
    """Return the imager of a run on a recipe's grid.

    Parameters
    ----------
    run : xarray.Dataset
        A run.
    table : ImageTable
        The table ``image`` of the recipe.
    subbands, polarizations : sequence of str
        Those to image; by default all.

    Returns
    -------
    ScanImager
        It makes images of single scans.
    """
    grid = table.grid()
    weights = table.weights(run["frequency"].values)
    bands = {name: table.subbands[name] for name in subbands or table.subbands}
    chosen = run.sel(polarization=list(polarizations)) if polarizations else run
    return ScanImager(chosen, grid, bands, weights, table.tolerance, table.device)


class RunImages:
    """Images of a run, scan by scan, of data that the recipe's clutter stages have cleaned.

    Parameters
    ----------
    run : xarray.Dataset
        The run, without scans whose poses are not plausible.
    recipe : Recipe
        The recipe.
    lane : Lane
        The lane.
    model : Model
        What the recipe's stages have learnt.
    results : mapping
        Results of earlier passes.
    others : mapping of str to xarray.Dataset
        Runs taken together with this one.

    Attributes
    ----------
    imager : ScanImager
        Makes images of the polarizations that are imaged, on the recipe's grid.
    grid : Grid
        The pixels of that grid as far ahead as counts.
    setup : Setup
        What stages are given.
    plain : bool
        Whether images are those of the run's own scans: nothing is cleaned or summed.
    in_memory : bool
        Whether images stay in memory once they are made.
    """

    def __init__(
        self,
        run: xr.Dataset,
        recipe: Recipe,
        lane: Lane,
        model: Model,
        results: Mapping[str, Any],
        others: Mapping[str, xr.Dataset],
    ) -> None:
        table = recipe.image
        labels = [str(label) for label in run["polarization"].values]
        imaged = list(table.polarizations) or labels
        self.frames = table.summed
        source = imager_of(run, table)
        self.imager = source if imaged == labels else imager_of(run, table, polarizations=imaged)
        self.grid = recipe.near_grid()
        entries = recipe.named()
        # The image of an aperture takes long to make, and is the only one of its run.
        pixels = self.imager.grid.nx * self.imager.grid.ny
        image_bytes = 8 * len(imaged) * len(table.subbands) * pixels
        self.in_memory = len(self.imager) == 1 and image_bytes <= CACHE
        self._made: dict[int, xr.DataArray] = {}  # images in memory, by index of the scan
        self.setup = Setup(
            run=run,
            others=others,
            lane=lane,
            imager=source,
            images=self.grid,
            view=recipe.run_view.grid(lane),
            imaged=[labels.index(label) for label in imaged],
            summed=self.frames,
            results=results,
        )
        self.stages = make_clutter_stages(entries, self.setup, model.stages, self._raw)
        self._data = self._raw
        if self.stages:
            last_stage = list(self.stages.values())[-1]
            self._data = last_stage.data
        self.plain = not self.stages and self.frames == 1

    def passes(self) -> list[PlannedPass]:
        """List the passes that the clutter stages need before the first image."""
        passes = []
        for stage in self.stages.values():
            passes += stage.passes()
        return passes

    def scan_image(self, index: int, rows: int | None = None) -> xr.DataArray:
        """Return the image of a scan, the coherent mean of the last scans up to it.

        Parameters
        ----------
        index : int
            Index of the scan among the complete ones.
        rows : int, optional
            The nearest rows that are needed; by default all. There may be more.

        Returns
        -------
        (polarization, subband, y, x) DataArray of complex
            With the scan's number and pose.
        """
        if not self.in_memory:
            return self._make_image(index, rows)
        if index not in self._made:
            self._made[index] = self._make_image(index)
        return self._made[index]

    def _make_image(self, index: int, rows: int | None = None) -> xr.DataArray:
        """Compute the image of a scan, as of :meth:`scan_image`."""
        scan = int(self.imager.scans[index])
        if self.plain:
            return self.imager.image(scan, None, rows)
        frames = self._data(index, self.frames)[:, self.setup.imaged]
        if len(frames) == 1:
            return self.imager.image(scan, frames[0], rows)

        # Fuse et al. 2018, Eq. 4: earlier scans are imaged on the ground ahead of the latest.
        points = scan_to_lane(self.imager.grid.points(), self.setup.pose(index))
        total = self.imager.operator(scan).adjoint(frames[-1])
        for back, frame in enumerate(frames[-2::-1], 1):
            earlier = int(self.imager.scans[index - back])
            places = lane_to_scan(points, self.setup.pose(index - back))
            operator = self.imager.operator_on(earlier, places, self.imager.subbands)
            total += operator.adjoint(frame)
        return self.imager.labelled(scan, np.asarray(total / np.float32(len(frames)), np.complex64))

    def _raw(self, index: int, count: int) -> ComplexArray:
        """Return the measured data of the last ``count`` scans up to an index."""
        scans = self.setup.imager.scans[max(index - count + 1, 0) : index + 1]
        return np.stack([self.setup.imager.signal(int(scan)) for scan in scans])
