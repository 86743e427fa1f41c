"""A run's images as a recipe wants them: cleaned data of the last scans, summed coherently, polarizations chosen."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr

from flgpr.chain.engine import PlannedPass
from flgpr.chain.model import Model
from flgpr.chain.recipe import ImageTable, Recipe
from flgpr.chain.stages import ClutterStage, ComplexArray, Setup, make_stage
from flgpr.imaging import ScanImager
from flgpr.model import Lane, lane_to_scan, scan_to_lane


def imager_of(
    run: xr.Dataset,
    table: ImageTable,
    subbands: Sequence[str] = (),
    polarizations: Sequence[str] = (),
) -> ScanImager:
    """Make the imager of a run on a recipe's grid, of some of its sub-bands and polarizations; default all."""
    bands = {name: table.subbands[name] for name in subbands or table.subbands}
    chosen = run.sel(polarization=list(polarizations)) if polarizations else run
    weights = table.weights(run["frequency"].values)
    return ScanImager(chosen, table.grid(), bands, weights, table.tolerance, table.device)


class RunImages:
    """Images of a run, scan by scan, with its recipe's clutter stages in between.

    ``imager`` has the polarizations that are imaged, on the recipe's grid, of which ``grid`` has
    the pixels as far ahead as counts; ``plain`` says whether images are those of the run's own
    scans; ``setup`` is what stages are told.
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
        wanted = list(table.polarizations) or labels
        source = imager_of(run, table)
        self.imager = source if wanted == labels else imager_of(run, table, polarizations=wanted)
        self.frames = table.summed
        self.grid = recipe.near_grid()
        self.setup = Setup(
            run, others, lane, source, self.grid, recipe.run_view.grid(lane), [labels.index(label) for label in wanted],
            self.frames, results,
        )  # fmt: skip
        self.stages: dict[str, ClutterStage] = {}
        before = self._raw
        for name, named in recipe.named().items():
            if issubclass(named.stage_class, ClutterStage):
                stage = make_stage(name, named, self.setup, model.stages.get(name))
                stage.before = before
                self.stages[name] = stage
                before = stage.data
                if named.stage_class.learns and name not in model.stages:
                    break  # what comes after it works on what it will leave
        self.plain = not self.stages and self.frames == 1
        self._data = before

    def passes(self) -> list[PlannedPass]:
        """List the passes that the clutter stages need beforehand."""
        return [each for stage in self.stages.values() for each in stage.passes()]

    def image(
        self, index: int, data: ComplexArray | None = None, rows: int | None = None
    ) -> xr.DataArray:
        """Image of the scan at an index among the complete ones, at least its nearest ``rows``, by default all.

        ``data`` stands in for a plain scan's own.
        """
        scan = int(self.imager.scans[index])
        if self.plain:
            return self.imager.image(scan, data, rows)
        frames = self._data(index, self.frames)[:, self.setup.imaged]
        if len(frames) == 1:
            return self.imager.image(scan, frames[0], rows)
        points = scan_to_lane(self.imager.grid.points(), self.setup.pose(index))
        total = self.imager.operator(scan).adjoint(frames[-1])
        for back, frame in enumerate(frames[-2::-1], 1):
            earlier = int(self.imager.scans[index - back])
            where = lane_to_scan(points, self.setup.pose(index - back))
            total += self.imager.operator_on(earlier, where, self.imager.subbands).adjoint(frame)
        return self.imager.labelled(scan, np.asarray(total / np.float32(len(frames)), np.complex64))

    def _raw(self, index: int, count: int) -> ComplexArray:
        scans = self.setup.imager.scans[max(index - count + 1, 0) : index + 1]
        return np.stack([self.setup.imager.signal(int(scan)) for scan in scans])
