"""What the passes over one lane have in common: run, recipe, stages, grids, and the results of earlier passes."""

from __future__ import annotations

from collections.abc import Mapping, MutableMapping
from functools import cached_property
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from flgpr.chain.cleaned import CleanedRun
from flgpr.chain.engine import PlannedPass, group_of
from flgpr.chain.evidence import MOST_GATHERED, EvidenceSums
from flgpr.chain.images import RunImages
from flgpr.chain.memory import CACHE
from flgpr.chain.model import Detector, Model, as_model, unlearnt
from flgpr.chain.recipe import Recipe, as_imaged
from flgpr.chain.sections import Section, kept_rows, lane_threshold
from flgpr.chain.stages import (
    FeatureStage,
    FloatArray,
    MapStage,
    ScreenStage,
    Stage,
    make_stage,
)
from flgpr.chain.steps import Steps, check_confidence
from flgpr.model import Lane
from flgpr.screen import RunViewSums, view_array


class LaneSetup:
    """A recipe on one lane of a run: what its passes read that no pass changes, and ``results`` of earlier passes.

    The recipe must fit the run and have a model if it learns, whose detector scores the alarms; by
    default their local contrast does. With a ``section`` only those rows of the lane's run-view are
    worked on: backgrounds are those of the whole run, and run-view, alarms and features those that
    the whole lane has there. ``others`` are runs taken together with it, by the names that the
    recipe gives them; ``truth`` are the targets of a training lane, for the first stage that has
    not learnt yet. With ``explains`` what explains the alarms to the viewer is gathered, too; with
    ``whole_background`` the background reaches as far as the images, by default as far ahead as
    counts and as that depends on.
    """

    def __init__(
        self,
        run: xr.Dataset,
        recipe: Recipe,
        lane: Lane,
        model: Model | Detector | None = None,
        results: MutableMapping[str, Any] | None = None,
        section: Section | None = None,
        others: Mapping[str, xr.Dataset] | None = None,
        truth: pd.DataFrame | None = None,
        explains: bool = True,
        whole_background: bool = False,
    ) -> None:
        self.run = run
        self.recipe = recipe
        self.lane = lane
        self.model = as_model(model)
        self.results: MutableMapping[str, Any] = {} if results is None else results
        self.truth = pd.DataFrame({"x": [], "y": []}) if truth is None else truth
        self.explains = explains
        self.untrained = unlearnt(recipe, self.model, training=truth is not None)
        self.images = RunImages(
            as_imaged(run, recipe), recipe, lane, self.model, self.results, others or {}
        )
        self.imager = self.images.imager
        self.setup = self.images.setup
        self.background_rows = self._background_rows(whole_background)
        self.stages = self._stages()
        self.mapper = self._first_stage(MapStage)
        self.screener = self._first_stage(ScreenStage)
        self.columns = [stage for stage in self.stages.values() if isinstance(stage, FeatureStage)]
        self.steps = self._steps()
        self.grid = self.setup.view
        if not self.untrained:
            check_confidence(recipe, self._column_names())
        self.section = Section(0, self.grid.ny) if section is None else section
        self.view_rows = kept_rows(recipe, lane, self.section)
        self._images: dict[int, xr.DataArray] = {}

    def _background_rows(self, whole: bool) -> int:
        """Return how many rows of the images the background is estimated on."""
        rows = self.imager.grid.ny
        if whole:
            return rows
        (median, _), (mean, _), _ = self.recipe.smoothing
        return min(self.images.grid.ny + median // 2 + mean // 2, rows)

    def _stages(self) -> dict[str, Stage]:
        """Make the stages that the recipe names, but for those of clutter, which belong to the images."""
        stages = {}
        for name, named in self.recipe.named().items():
            if not name.startswith("clutter."):
                learnt = self.model.stages.get(name)
                stages[name] = make_stage(name, named, self.setup, learnt)
        return stages

    def _first_stage(self, kind: type[Any]) -> Any:
        for stage in self.stages.values():
            if isinstance(stage, kind):
                return stage
        return None

    def _steps(self) -> Steps:
        """Make the steps that the recipe takes with images, a run-view and alarms."""
        stages = {
            name: stage
            for name, stage in self.stages.items()
            if isinstance(stage, FeatureStage) and stage.columns
        }
        subbands = list(self.recipe.image.subbands)
        return Steps(
            self.recipe,
            self.polarizations,
            subbands,
            self.images.grid,
            stages,
            detector=self.model.detector,
        )

    @property
    def polarizations(self) -> list[str]:
        """Names of the polarizations that are imaged."""
        return [str(label) for label in self.imager.run["polarization"].values]

    @property
    def concurrent(self) -> bool:
        """Whether several threads may work on blocks at once: stages may keep things from scan to scan."""
        return self.images.plain and not self.stages

    @cached_property
    def _remembers(self) -> bool:
        """Whether images stay in memory: that of an aperture, which is the only one of its run, is dear."""
        grid = self.imager.grid
        channels = len(self.setup.imaged) * len(self.recipe.image.subbands) * grid.nx * grid.ny
        return len(self.imager) == 1 and 8 * len(self.imager) * channels <= CACHE

    def image(self, index: int, rows: int | None = None) -> xr.DataArray:
        """Return the image of the scan at an index among the complete ones, at least its nearest ``rows``."""
        if not self._remembers:
            return self.images.image(index, None, rows)
        if index not in self._images:
            self._images[index] = self.images.image(index)
        return self._images[index]

    @cached_property
    def cleaned(self) -> CleanedRun:
        """The run's cleaned images; needs the result of the pass "gain"."""
        whole_image = self.image if self._remembers else None
        return CleanedRun(self.images, self.results["gain"], whole_image)

    @cached_property
    def reads_data_once(self) -> bool:
        """Whether the data of a scan, read once, serve its image and what explains alarms."""
        return self.explains and self.imager.run is self.setup.run

    def stage_passes(self) -> list[PlannedPass]:
        """List the passes that the recipe's stages need before the first image is cleaned."""
        passes = self.images.passes()
        for stage in self.stages.values():
            passes += stage.passes()
        return passes

    def stage_notes(self) -> dict[str, Any]:
        """Return figures worth reporting of the recipe's stages, once their passes are done."""
        notes: dict[str, Any] = {}
        for stage in [*self.images.stages.values(), *self.stages.values()]:
            notes |= stage.notes()
        return notes

    # The lane's run-view and its rows

    def rows_of(self, block: range | None) -> slice:
        """Return the rows of the run-view, among those that the section needs, that a block's scans reach."""
        if block is None:
            return self.view_rows
        sums = RunViewSums(self.grid, self.recipe.run_view.y_max, slice(0, 0))
        reached = [sums.reach(self.imager.grid, self.setup.pose(index)) for index in block]
        first = max(min(rows.start for rows in reached), self.view_rows.start)
        last = min(max(rows.stop for rows in reached), self.view_rows.stop)
        return slice(first, max(last, first))

    def block_numbers(self, blocks: list[range]) -> list[int]:
        """Return the numbers of the blocks that reach the section, at least one."""
        numbers = []
        for number, block in enumerate(blocks):
            rows = self.rows_of(block)
            if rows.start < rows.stop:
                numbers.append(number)
        return numbers or [0]

    @property
    def own_rows(self) -> slice:
        """The section's own rows among those of its run-view."""
        first = self.view_rows.start
        return slice(self.section.start - first, self.section.stop - first)

    def labels(self, of_images: bool = False) -> dict[str, list[str]]:
        """Name the channels of the run-view or, if asked for, those of the images."""
        if of_images:
            return {
                "polarization": self.polarizations,
                "subband": list(self.recipe.image.subbands),
            }
        mapped = self.recipe.map
        return {
            "polarization": self.polarizations if mapped is None else [mapped.stage],
            "subband": self.recipe.view_channels,
        }

    def view(self, name: str = "view", all_rows: bool = False) -> xr.DataArray:
        """Return the run-view, or that "before" its background is removed; needs the pass "view".

        It has the section's own rows or, if asked for, those around them that the section needs,
        too.
        """
        arrays = self.results["view"]
        if self.explains:
            arrays = group_of(arrays, name)
        labels = self.labels(of_images=name == "before")
        if all_rows:
            return view_array(arrays["view"], arrays["looks"], self.grid, labels, self.view_rows)
        own = self.own_rows
        values = arrays["view"][..., own, :]
        return view_array(values, arrays["looks"][own], self.grid, labels, self.section.rows)

    def alarms(self) -> pd.DataFrame:
        """Return the alarms that the density rule leaves of the maxima; needs the pass "alarms"."""
        raised = self.results["alarms"]
        table = array_table(group_of(raised, "maximum"))
        threshold = self.section.threshold
        if threshold is None:
            threshold = lane_threshold(self.recipe, self.lane, table, int(raised["seen"]))
        return table[table["magnitude"] >= threshold].reset_index(drop=True)

    def evidence_sums(self, poses: Mapping[int, FloatArray] | None = None) -> EvidenceSums:
        """Make the sums of what explains the strongest alarms; needs the pass "alarms"."""
        contrast = self.recipe.contrast
        run_view = self.recipe.run_view
        explains_map = self.mapper is not None and run_view.look == "mean"
        return EvidenceSums(
            self.alarms().iloc[:MOST_GATHERED],
            contrast.patch(),
            run_view.y_max,
            self.setup.run,
            contrast.subband,
            poses,
            self.mapper.parts if explains_map else None,
            run_view.falloff,
        )

    def _column_names(self) -> list[str]:
        """Name the columns of all feature stages; those of the run-view tell theirs where there is no alarm."""
        labels = self.labels()
        rows = min(2, self.grid.ny)
        shape = (len(labels["polarization"]), len(labels["subband"]), rows, self.grid.nx)
        unseen = np.full(shape, np.nan, np.float32)
        looks = np.zeros(shape[-2:], np.int64)
        empty = view_array(unseen, looks, self.grid, labels, slice(rows))
        names: list[str] = []
        for stage in self.columns:
            names += stage.columns
            names += stage.of_view(empty, np.zeros((0, 2)))
        return names


def table_arrays(table: pd.DataFrame) -> dict[str, Any]:
    """Return one array per column of a table of numbers."""
    return {str(name): table[name].to_numpy() for name in table.columns}


def array_table(arrays: Mapping[str, Any]) -> pd.DataFrame:
    """Return the table that :func:`table_arrays` took apart."""
    return pd.DataFrame({name: arrays[name] for name in arrays})
