"""A run as a recipe images, cleans and searches it: what its passes read and none of them changes.

Clutter stages clean the data, the last scans are summed coherently, and only the polarizations that
the recipe names are imaged. Images are made anew on every pass.
"""

from __future__ import annotations

from collections.abc import Mapping, MutableMapping, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from flgpr.clutter import Background
from flgpr.engine import group_of
from flgpr.imaging import ScanImager
from flgpr.method.alarm_sums import check_column_count
from flgpr.method.evidence import MOST_GATHERED, EvidenceSums
from flgpr.method.memory import CACHE
from flgpr.method.model import Detector, Model, as_model, unlearnt
from flgpr.method.sections import Section, kept_rows, lane_threshold
from flgpr.method.steps import Steps, check_confidence
from flgpr.method.unlike import (
    MEASURED,
    Comparison,
    Trust,
    compare_clutter,
    compare_level,
    level_profile,
    why_not,
)
from flgpr.model import Lane, lane_to_scan, scan_to_lane
from flgpr.model.run import polarizations_of
from flgpr.recipe.schema import Recipe, as_imaged
from flgpr.recipe.tables import ImageTable
from flgpr.screen import view_array
from flgpr.screen.views import pixels_at, reached_rows
from flgpr.stages import FeatureStage, MapStage, ScreenStage, Setup, Stage, measured, scan_number
from flgpr.stages.named import make_clutter_stages, make_stages
from flgpr.types import AnyArray, ComplexArray, Entries, FloatArray, floats


class ImagedRun:
    """A run as a recipe images, cleans and searches it.

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
    trust : Trust, optional
        What is done on ground that is unlike the training, and the false-alarm rate that is wanted.

    Attributes
    ----------
    imager : ScanImager
        Makes images of the polarizations that are imaged, on the recipe's grid.
    near : Grid
        The pixels of that grid as far ahead as counts, in the scan frame.
    grid : Grid
        The pixels of the run-view, in the lane frame.
    setup : Setup
        What stages are given.
    plain : bool
        Whether images are those of the run's own scans: nothing is cleaned or summed.
    in_memory : bool
        Whether images stay in memory once they are made.

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
        trust: Trust | None = None,
    ) -> None:
        self.trust = trust or Trust()
        self.run = run
        self.recipe = recipe
        self.lane = lane
        self.model = as_model(model)
        self.results: MutableMapping[str, Any] = {} if results is None else results
        self.truth = pd.DataFrame({"x": [], "y": []}) if truth is None else truth
        self.explains = explains
        self.untrained = unlearnt(recipe, self.model, training=truth is not None)
        self._set_up(as_imaged(run, recipe), others or {})
        self.near = self.setup.images
        self.grid = self.setup.view
        # The image of an aperture takes long to make, and is the only one of its run.
        pixels = self.imager.grid.nx * self.imager.grid.ny
        channels = len(self.polarizations) * len(recipe.image.subbands)
        self.in_memory = len(self.imager) == 1 and 8 * channels * pixels <= CACHE
        self._made: dict[int, xr.DataArray] = {}  # images in memory, by index of the scan

        entries = recipe.named()
        learnt = self.model.stages
        self.clutter_stages = make_clutter_stages(entries, self.setup, learnt, self._raw)
        self.stages = make_stages(entries, self.setup, learnt)
        self.plain = not self.clutter_stages and self.setup.summed == 1
        check_column_count(recipe, len(self.polarizations), self.grid)
        self.background_rows = self._background_rows(whole_background)
        self.mapper = self._first_stage(MapStage)
        if self.mapper is not None:
            self.mapper.substitute = lambda: "own" if self.replaces_map else ""
        self.screener = self._first_stage(ScreenStage)
        #: the stage that subtracts what earlier drives predict; None without it
        self.earlier: Any = self.clutter_stages.get("clutter.earlier")
        self.columns = [stage for stage in self.stages.values() if isinstance(stage, FeatureStage)]
        image_stages = {}
        for name, stage in self.stages.items():
            if isinstance(stage, FeatureStage) and stage.columns:
                image_stages[name] = stage
        self.steps = Steps(
            recipe=self.recipe,
            polarizations=self.polarizations,
            subbands=list(self.recipe.image.subbands),
            grid=self.near,
            stages=image_stages,
            detector=self.model.detector,
        )
        if not self.untrained:
            names = self._column_names()
            check_confidence(recipe, names)
        self.section = Section(0, self.grid.ny) if section is None else section
        self.view_rows = kept_rows(recipe, lane, self.section)

    def _set_up(self, run: xr.Dataset, others: Mapping[str, xr.Dataset]) -> None:
        """Make what stages are given, and the imager of the polarizations that count."""
        table = self.recipe.image
        labels = polarizations_of(run)
        imaged = list(table.polarizations) or labels
        self.imager = source = imager_of(run, table)
        if imaged != labels:
            self.imager = imager_of(run, table, polarizations=imaged)
        self.setup = Setup(
            run=run,
            others=others,
            lane=self.lane,
            imager=source,
            images=self.recipe.near_grid(),
            view=self.recipe.run_view.grid(self.lane),
            imaged=[labels.index(label) for label in imaged],
            summed=table.summed,
            results=self.results,
        )

    def _background_rows(self, all_rows: bool) -> int:
        """Return how many rows of the images the background is estimated on."""
        rows = self.imager.grid.ny
        if all_rows:
            return rows
        # The filters of the gain background read so many rows beyond the last that counts.
        (median, _), (mean, _), _ = self.recipe.smoothing
        return min(self.near.ny + median // 2 + mean // 2, rows)

    def _first_stage(self, kind: type[Any]) -> Any:
        """Return the first stage of a kind, or None."""
        for stage in self.stages.values():
            if isinstance(stage, kind):
                return stage
        return None

    @property
    def polarizations(self) -> list[str]:
        """Names of the polarizations that are imaged."""
        return polarizations_of(self.imager.run)

    @property
    def concurrent(self) -> bool:
        """Whether several threads may work on blocks at once.

        Stages may keep state from scan to scan.
        """
        return self.plain and not self.stages

    @cached_property
    def reads_data_once(self) -> bool:
        """Whether a scan's image and what explains alarms are made of the same data."""
        return self.explains and self.imager.run is self.setup.run

    @property
    def all_stages(self) -> list[Stage]:
        """Clutter stages, which clean data before there are images, and all others."""
        return [*self.clutter_stages.values(), *self.stages.values()]

    def in_section(self, section: Section | None, results: MutableMapping[str, Any]) -> ImagedRun:
        """Return the same lane with a section alone, which reads other results of passes."""
        return ImagedRun(
            self.run,
            self.recipe,
            self.lane,
            self.model,
            results=results,
            section=section,
            others=self.setup.others,
            trust=self.trust,
        )

    # Images of scans

    def __len__(self) -> int:
        return len(self.imager)

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
        image = self._summed_image(index, rows)
        for stage in self.clutter_stages.values():
            image = stage.of_image(index, image)
        return image

    def _summed_image(self, index: int, rows: int | None) -> xr.DataArray:
        """Return the coherent mean of the images of the last scans up to an index."""
        scan = scan_number(self.setup, index)
        if self.plain:
            return self.imager.image(scan, None, rows)
        frames = self._data(index, self.setup.summed)[:, self.setup.imaged]
        if len(frames) == 1:
            return self.imager.image(scan, frames[0], rows)

        # Fuse et al. 2018, Eq. 4: earlier scans are imaged on the ground ahead of the latest.
        points = scan_to_lane(self.imager.grid.points(), self.setup.pose(index))
        total = self.imager.operator(scan).adjoint(frames[-1])
        for back, frame in enumerate(frames[-2::-1], 1):
            earlier = scan_number(self.setup, index - back)
            places = lane_to_scan(points, self.setup.pose(index - back))
            operator = self.imager.operator_on(earlier, places, self.imager.subbands)
            total += operator.adjoint(frame)
        return self.imager.labelled(scan, np.asarray(total / np.float32(len(frames)), np.complex64))

    def _data(self, index: int, count: int) -> ComplexArray:
        """Return the data of the last ``count`` scans up to an index, as clutter stages left them."""
        if not self.clutter_stages:
            return self._raw(index, count)
        last_stage = list(self.clutter_stages.values())[-1]
        return last_stage.data(index, count)

    def _raw(self, index: int, count: int) -> ComplexArray:
        """Return the measured data of the last ``count`` scans up to an index."""
        indices = range(max(index - count + 1, 0), index + 1)
        return np.stack([measured(self.setup, one) for one in indices])

    # Cleaned images: they need the result of the pass "gain"

    @cached_property
    def gains(self) -> FloatArray:
        """The gain of every scan (scan, polarization, subband)."""
        gains: FloatArray = self.results["gain"]["gains"]
        return gains

    @cached_property
    def whole_background(self) -> Background:
        """The background of the rows that it was estimated on."""
        arrays = {name: array for name, array in self.results["gain"].items() if name != "gains"}
        return Background(**arrays)

    @cached_property
    def background(self) -> Background:
        """The background of the pixels that count, in units of which images are cleaned."""
        return self.whole_background.cropped(self.near.ny)

    @cached_property
    def near_imager(self) -> ScanImager:
        """Makes images of the pixels that count alone."""
        full = self.imager
        return ScanImager(
            full.run, self.near, full.subbands, full.window, full.tolerance, full.device
        )

    @property
    def reads_data(self) -> bool:
        """Whether a near image is made of its scan's data alone, without the pixels beyond."""
        return self.plain and not self.in_memory

    def near_image(self, index: int, data: ComplexArray | None = None) -> xr.DataArray:
        """Return the image of a scan before its background is removed, as far ahead as counts.

        Parameters
        ----------
        index : int
            Index of the scan among the complete ones.
        data : (polarization, pair, frequency) ndarray of complex, optional
            The scan's data, where they have been read already.

        Returns
        -------
        (polarization, subband, y, x) DataArray of complex
            With the scan's number and pose.
        """
        if self.reads_data:
            return self.near_imager.image(scan_number(self.setup, index), data)
        return self.scan_image(index).isel(y=slice(self.near.ny))

    def coherent(self, index: int) -> xr.DataArray:
        """Return the cleaned image of the scan at an index, with its phase.

        It is in units of the background, with a gain of each polarization's own.
        """
        image = self.near_image(index)
        return image.copy(data=self.background.own_coherent(image.values, self.gains[index]))

    # Whether the ground is like that of the training lanes: needs the passes "gain" and "unlike"

    @property
    def measures_clutter(self) -> bool:
        """Whether the map's clutter is measured, to be compared with that of training."""
        if self.mapper is None or not self.mapper.measures_clutter or self.untrained:
            return False
        ground = self.model.ground
        return self.trust.only_measures or (ground is not None and ground.judges)

    @cached_property
    def learnt_clutter(self) -> AnyArray:
        """What whitens the clutter that the map has learnt (metre, value, value)."""
        return np.asarray(self.mapper.learnt["whitener"])

    def level_profile(self) -> FloatArray:
        """Return the level of the images (channel, metre), dB over its mean."""
        across = (self.lane.x_min, self.lane.x_max)
        return level_profile(self.background.gain, self.near, across)

    @cached_property
    def comparison(self) -> Comparison | None:
        """How the ground compares with that of the training lanes; None where nothing was learnt."""
        model = self.model
        if model.detector is None and not model.stages:
            return None
        ground = model.ground
        cannot = why_not(ground)
        if ground is None or cannot:
            return Comparison(cannot=cannot)
        channels = [
            f"{label} {subband}"
            for label in self.polarizations
            for subband in self.recipe.image.subbands
        ]
        near = self.near.y_min
        figures = compare_level(ground, self.level_profile(), channels, near)
        if self.measures_clutter:
            measured = self.results[MEASURED]
            sums = {name: measured[name].sum(axis=0) for name in ("covariance", "count", "shape")}
            scans = int(measured["scans"])
            figures += compare_clutter(ground, sums, scans, self.learnt_clutter, near)
        if not figures:
            return Comparison(cannot="its training lanes were imaged on other pixels")
        return Comparison(tuple(figures))

    @property
    def substitute(self) -> str:
        """What stands in for what was learnt: "own", "contrast", or "" for nothing.

        Raises
        ------
        ValueError
            If ground that is unlike the training is to be refused.
        """
        if self.trust.unlike == "keep" or self.untrained or self.trust.only_measures:
            return ""
        comparison = self.comparison
        if comparison is None or not comparison.unlike:
            return ""
        if self.trust.unlike == "refuse":
            raise ValueError("; ".join(comparison.notes("it is refused, as asked for")))
        return comparison.substitute

    @property
    def replaces_map(self) -> bool:
        """Whether the lane's own clutter stands in for what the map has learnt."""
        return self.substitute == "own"

    # The lane's run-view and its rows

    def rows_of(self, block: range | None) -> slice:
        """Return the rows of the run-view that the section needs and the scans of a block reach.

        With None instead of a block, return all rows that the section needs.
        """
        if block is None:
            return self.view_rows
        y_max = self.recipe.run_view.y_max
        reached = []
        for index in block:
            pose = self.setup.pose(index)
            reached.append(reached_rows(self.grid, y_max, self.imager.grid, pose))
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
        name : {"view", "before", "earlier"}
            "before" is the run-view before the background is removed, and "earlier" that of an
            earlier drive, for the viewer.
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
        labels = self.labels(of_images=name != "view")
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

    def as_learnt_at(self, alarms: pd.DataFrame) -> FloatArray:
        """Return the run-view of the learnt map at alarms (alarm,), where something stands in for it."""
        arrays = self.results["view"]
        if self.explains:
            arrays = group_of(arrays, "view")
        row, column = pixels_at(self.grid, alarms["x"], alarms["y"])
        values = arrays["as_learnt"][0, 0, row - self.view_rows.start, column]
        return floats(values)

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
        bit = replace(self.grid, ny=min(2, self.grid.ny))
        shape = (len(labels["polarization"]), len(labels["subband"]), bit.ny, bit.nx)
        unseen = np.full(shape, np.nan, np.float32)
        empty = view_array(unseen, np.zeros(shape[-2:], np.int64), bit, labels)
        names: list[str] = []
        for stage in self.columns:
            names += stage.columns
            names += stage.of_view(empty, np.zeros((0, 2)))
        return names


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


def table_arrays(table: pd.DataFrame) -> Entries:
    """Return one array per column of a table of numbers."""
    return {str(name): table[name].to_numpy() for name in table.columns}


def array_table(arrays: Mapping[str, Any]) -> pd.DataFrame:
    """Return the table of columns that :func:`table_arrays` returned."""
    return pd.DataFrame({name: arrays[name] for name in arrays})
