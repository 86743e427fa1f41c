"""What the passes over one lane share: run, recipe, stages, grids and earlier results."""

from __future__ import annotations

from collections.abc import Mapping, MutableMapping
from functools import cached_property
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from flgpr.engine import PlannedPass, group_of
from flgpr.method.alarm_sums import check_column_count
from flgpr.method.cleaned import CleanedRun
from flgpr.method.evidence import MOST_GATHERED, EvidenceSums
from flgpr.method.images import RunImages
from flgpr.method.model import Detector, Model, as_model, unlearnt
from flgpr.method.sections import Section, kept_rows, lane_threshold
from flgpr.method.steps import Steps, check_confidence
from flgpr.model import Lane
from flgpr.recipe.schema import Recipe, as_imaged
from flgpr.screen import RunViewSums, view_array
from flgpr.stages import (
    FeatureStage,
    FloatArray,
    MapStage,
    ScreenStage,
    make_stages,
)


class LaneSetup:
    """A recipe on one lane of a run: what its passes read and no pass changes.

    Parameters
    ----------
    run : xarray.Dataset
        A run that the recipe fits.
    recipe : Recipe
        The recipe.
    lane : Lane
        The lane.
    model : Model or its detector, optional
        What the recipe's stages have learnt. The score of its detector is the confidence; by
        default the local contrast is.
    results : mutable mapping, optional
        Results of the passes by name; by default an empty dictionary.
    section : Section, optional
        Rows of the run-view to work on. Backgrounds are those of the whole run; run-view, alarms
        and features are those that the whole lane has there.
    others : mapping of str to xarray.Dataset, optional
        Runs taken together with this one, by the names that the recipe gives them.
    truth : DataFrame, optional
        The targets of a training lane, for the first stage that has not learnt yet.
    explains : bool
        Whether to gather what explains the alarms to the viewer.
    whole_background : bool
        Whether the background reaches as far as the images; by default it reaches as far ahead as
        counts and as the rows there depend on.

    Raises
    ------
    ValueError
        If the recipe needs a model that is not given, its confidence is no column of a stage, or
        its stages have more columns than a table of features may have.
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
        entries = recipe.named()
        imaged = as_imaged(run, recipe)
        self.images = RunImages(imaged, recipe, lane, self.model, self.results, others or {})
        self.imager = self.images.imager
        self.setup = self.images.setup
        # The clutter stages belong to the images.
        self.stages = make_stages(entries, self.setup, self.model.stages)
        self.grid = self.setup.view
        check_column_count(recipe, len(self.polarizations), self.grid)
        self.background_rows = self._background_rows(whole_background)
        self.mapper = self._first_stage(MapStage)
        self.screener = self._first_stage(ScreenStage)
        self.columns = [stage for stage in self.stages.values() if isinstance(stage, FeatureStage)]
        self.steps = self._steps()
        if not self.untrained:
            names = self._column_names()
            check_confidence(recipe, names)
        self.section = Section(0, self.grid.ny) if section is None else section
        self.view_rows = kept_rows(recipe, lane, self.section)

    def _background_rows(self, all_rows: bool) -> int:
        """Return how many rows of the images the background is estimated on."""
        rows = self.imager.grid.ny
        if all_rows:
            return rows
        # The filters of the gain background read so many rows beyond the last that counts.
        (median, _), (mean, _), _ = self.recipe.smoothing
        return min(self.images.grid.ny + median // 2 + mean // 2, rows)

    def _first_stage(self, kind: type[Any]) -> Any:
        """Return the first stage of a kind, or None."""
        for stage in self.stages.values():
            if isinstance(stage, kind):
                return stage
        return None

    def _steps(self) -> Steps:
        """Make the steps that the recipe takes with images, a run-view and alarms."""
        image_stages = {}
        for name, stage in self.stages.items():
            if isinstance(stage, FeatureStage) and stage.columns:
                image_stages[name] = stage
        return Steps(
            recipe=self.recipe,
            polarizations=self.polarizations,
            subbands=list(self.recipe.image.subbands),
            grid=self.images.grid,
            stages=image_stages,
            detector=self.model.detector,
        )

    @property
    def polarizations(self) -> list[str]:
        """Names of the polarizations that are imaged."""
        return [str(label) for label in self.imager.run["polarization"].values]

    @property
    def concurrent(self) -> bool:
        """Whether several threads may work on blocks at once.

        Stages may keep state from scan to scan.
        """
        return self.images.plain and not self.stages

    @cached_property
    def cleaned(self) -> CleanedRun:
        """The run's cleaned images; needs the result of the pass "gain"."""
        return CleanedRun(self.images, self.results["gain"])

    @cached_property
    def reads_data_once(self) -> bool:
        """Whether a scan's image and what explains alarms are made of the same data."""
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
        """Return the rows of the run-view that the section needs and the scans of a block reach.

        With None instead of a block, return all rows that the section needs.
        """
        if block is None:
            return self.view_rows
        sums = RunViewSums(self.grid, self.recipe.run_view.y_max, slice(0, 0))
        reached = [sums.reach(self.imager.grid, self.setup.pose(index)) for index in block]
        first_reached = min(rows.start for rows in reached)
        last_reached = max(rows.stop for rows in reached)
        first = max(first_reached, self.view_rows.start)
        last = min(last_reached, self.view_rows.stop)
        return slice(first, max(last, first))

    def block_numbers(self, blocks: list[range]) -> list[int]:
        """Return the numbers of the blocks that reach the section; the first if none does."""
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
        """Return the names of the channels of the run-view, or of the images."""
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
        """Return the run-view; needs the result of the pass "view".

        Parameters
        ----------
        name : {"view", "before"}
            "before" is the run-view before the background is removed, for the viewer.
        all_rows : bool
            Whether to return the rows around the section that it needs, beside its own.

        Returns
        -------
        (polarization, subband, y, x) DataArray
            In units of the background.
        """
        arrays = self.results["view"]
        if self.explains:
            arrays = group_of(arrays, name)
        labels = self.labels(of_images=name == "before")
        if all_rows:
            return view_array(arrays["view"], arrays["looks"], self.grid, labels, self.view_rows)
        values = arrays["view"][..., self.own_rows, :]
        looks = arrays["looks"][self.own_rows]
        return view_array(values, looks, self.grid, labels, self.section.rows)

    def alarms(self) -> pd.DataFrame:
        """Return the maxima that are alarms by the density rule (Wang et al. 2007, Sec. II-B).

        Needs the result of the pass "alarms".
        """
        raised = self.results["alarms"]
        table = array_table(group_of(raised, "maximum"))
        threshold = self.section.threshold
        if threshold is None:
            threshold = lane_threshold(self.recipe, self.lane, table, int(raised["seen"]))
        return table[table["magnitude"] >= threshold].reset_index(drop=True)

    def evidence_sums(self, poses: Mapping[int, FloatArray] | None = None) -> EvidenceSums:
        """Return the empty sums of what explains the strongest alarms; needs the pass "alarms".

        ``poses`` are those of all scans that may see the same alarms, by scan number.
        """
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
        """Return the names of the columns of all feature stages."""
        labels = self.labels()
        # Stages that read the run-view name their columns when they are asked about no alarms, on a
        # bit of a run-view that no scan saw.
        rows = min(2, self.grid.ny)
        shape = (len(labels["polarization"]), len(labels["subband"]), rows, self.grid.nx)
        unseen = np.full(shape, np.nan, np.float32)
        no_looks = np.zeros(shape[-2:], np.int64)
        empty = view_array(unseen, no_looks, self.grid, labels, slice(rows))
        names: list[str] = []
        for stage in self.columns:
            names += stage.columns
            names += stage.of_view(empty, np.zeros((0, 2)))
        return names


def table_arrays(table: pd.DataFrame) -> dict[str, Any]:
    """Return one array per column of a table of numbers."""
    return {str(name): table[name].to_numpy() for name in table.columns}


def array_table(arrays: Mapping[str, Any]) -> pd.DataFrame:
    """Return the table of columns that :func:`table_arrays` returned."""
    return pd.DataFrame({name: arrays[name] for name in arrays})
