"""The chain with features cut into blocks of scans: what can be done anywhere, and what is folded in between.

Every stage is one pass over the scans. ``part`` works on one block and depends on nothing but the run, the recipe and
the folded results of earlier stages; ``fold`` brings the parts together in the order of the blocks. So the bits of a
result depend neither on how many work on it, nor where, nor on what was interrupted in between.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, MutableMapping, Sequence
from functools import cached_property
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

from flgpr.model import Lane
from flgpr.pipeline.classifier import Classifier
from flgpr.pipeline.progress import Track, silent
from flgpr.pipeline.recipe import Recipe
from flgpr.pipeline.sections import Section, kept_rows, lane_threshold
from flgpr.pipeline.view_evidence import Evidence, EvidenceSums
from flgpr.pipeline.wang2007 import (
    Arrays,
    CleanedRun,
    Found,
    Places,
    background_of,
    blocks_of,
    cleaned_grid,
    features_of,
    features_part,
    gain_part,
    named,
    plainly,
    signature_of,
    signature_part,
    under,
    whole_imager,
)
from flgpr.screen import RunViewSums, local_maxima, select, view_array

STAGES = {
    "signature": "self-signature",
    "gain": "gain background",
    "view": "run-view",
    "features": "features",
    "evidence": "explaining alarms",
}
"""The passes in their order, and what they are called where progress is shown."""


class FeatureChain:
    """The passes of the chain with features over one run.

    Parameters
    ----------
    run : xarray.Dataset
        A run with HH, VV and HV or VH.
    recipe : Recipe
        Recipe with the table features.
    lane : Lane
        The lane.
    classifier : Classifier, optional
        Scores the alarms; default: their local contrast.
    known : mutable mapping of str to dict of ndarray, optional
        Folded results by stage, kept here and looked up here.
    section : Section, optional
        The rows of the lane's run-view that are asked for; default all. Backgrounds are those of the whole run, and
        run-view, alarms and features those that the whole lane has there.

    Raises
    ------
    ValueError
        If the recipe has no table features or does not fit the run.
    """

    def __init__(
        self,
        run: xr.Dataset,
        recipe: Recipe,
        lane: Lane,
        classifier: Classifier | None = None,
        known: MutableMapping[str, Any] | None = None,
        section: Section | None = None,
    ) -> None:
        if recipe.features is None:
            raise ValueError("recipe must have the table features")
        self.run, self.recipe, self.lane, self.classifier = run, recipe, lane, classifier
        self.known: MutableMapping[str, Any] = {} if known is None else known
        self.imager = whole_imager(run, recipe)
        self.blocks = blocks_of(len(self.imager))
        self.grid = recipe.run_view.grid(lane)
        self.section = Section(0, self.grid.ny) if section is None else section
        self._kept = kept_rows(recipe, lane, self.section)

    def numbers(self, stage: str) -> list[int]:
        """Tell which blocks a stage goes through.

        Parameters
        ----------
        stage : str
            One of ``STAGES``.

        Returns
        -------
        list of int
            All of them for the background; for the rest those that reach the section, and at least one.
        """
        return list(range(len(self.blocks))) if stage in ("signature", "gain") else self._reaching

    def go(self, track: Track = silent, stages: Sequence[str] = tuple(STAGES)) -> None:
        """Do stages here and now, block after block; those already known are left out.

        Parameters
        ----------
        track : Track
            Shows progress.
        stages : sequence of str
            Which, in their order.
        """
        for stage in stages:
            if stage not in self.known:
                every = self.numbers(stage)
                numbers = track(every, STAGES[stage], len(every))
                self.known[stage] = self.fold(stage, (self.part(stage, number) for number in numbers))

    def part(self, stage: str, number: int, places: Places = plainly) -> Arrays:
        """Work on one block.

        Parameters
        ----------
        stage : str
            One of ``STAGES``, the earlier ones being known.
        number : int
            Number of the block.
        places : Places
            Goes through the block's scans; may keep what was gathered.

        Returns
        -------
        dict of ndarray
            What the fold of the stage needs of it.
        """
        block = self.blocks[number]
        if stage == "signature":
            return signature_part(self.imager, self.recipe, block, places)
        if stage == "gain":
            return gain_part(self.imager, self.recipe, block, self.known["signature"], places)
        if stage == "view":
            return self._view_part(block, places)
        if stage == "features":
            return features_part(self.cleaned, self.run, self.recipe, self.raised(), block, places)
        return self._evidence_part(block, places)

    def fold(self, stage: str, parts: Iterable[Arrays]) -> Arrays:
        """Bring the parts of a stage together.

        Parameters
        ----------
        stage : str
            One of ``STAGES``.
        parts : iterable of dict of ndarray
            What :meth:`part` gave for the blocks of :meth:`numbers`, in their order. They are taken one by one.

        Returns
        -------
        dict of ndarray
            The stage's result.
        """
        if stage == "signature":
            return signature_of(self.recipe, parts)
        if stage == "gain":
            return background_of(self.recipe, parts, self.known["signature"])
        if stage == "view":
            return self._view(parts)
        if stage == "features":
            split = ({name: under(part, name) for name in _prefixes(part)} for part in parts)
            return table_arrays(features_of(self.cleaned, self.run, self.recipe, self.raised(), split))
        return self._evidence_result(parts)

    @cached_property
    def _reaching(self) -> list[int]:
        windows = [self._rows(block) for block in self.blocks]
        return [number for number, rows in enumerate(windows) if rows.start < rows.stop] or [0]

    @cached_property
    def cleaned(self) -> CleanedRun:
        """The run's cleaned images; needs the stage ``gain``."""
        return CleanedRun(self.run, self.recipe, silent, self.known["gain"])

    def maxima(self) -> pd.DataFrame:
        """Give the local maxima of the prescreener's channel, before the density rule; needs the stage ``view``."""
        return array_table(self.known["view"], "maximum.")

    def raised(self) -> pd.DataFrame:
        """Give the prescreener's alarms; needs the stage ``view``."""
        table, threshold = self.maxima(), self.section.threshold
        if threshold is None:
            threshold = lane_threshold(self.recipe, self.lane, table, int(self.known["view"]["seen"]))
        return table[table["magnitude"] >= threshold].reset_index(drop=True)

    def found(self) -> Found:
        """Give alarms, features and run-view; needs the stage ``features``."""
        features, classifier = array_table(self.known["features"]), self.classifier
        single = f"C_{self.recipe.contrast.polarization}_{self.recipe.contrast.subband}"
        confidence = features[single] if classifier is None else classifier.confidence(features)
        notes = {"confidence": single if classifier is None else " + ".join(classifier.features)}
        alarms = self.raised().assign(confidence=confidence, scans=features["scans"])
        return Found(alarms, features, self._own_view("view"), notes)

    def evidence(self) -> tuple[Evidence, xr.DataArray]:
        """Give what explains the alarms, and the run-view before suppression; needs the stage ``evidence``."""
        sums = self._evidence_sums()
        sums.take(under(self.known["evidence"], "evidence"))
        return sums.result(), self._own_view("evidence")

    def _own_view(self, stage: str) -> xr.DataArray:
        return self._as_view(self.known[stage]["view"], self.known[stage]["looks"], self.section.rows)

    def _view_part(self, block: range, places: Places) -> Arrays:
        sums = self._window(block)
        for image, gain, pose in self.cleaned.scans(places(block, sums.take, sums.sums)):
            sums.add(self.cleaned.background.magnitude(image, gain), self.cleaned.grid, pose)
        return sums.sums()

    def _view(self, parts: Iterable[Arrays]) -> Arrays:
        sums = RunViewSums(self.grid, self.recipe.run_view.y_max, self._kept)
        for part in parts:
            sums.take(part)
        values, looks = sums.result()
        screen, section = self.recipe.prescreen, self.section
        chosen = select(self._as_view(values, looks, self._kept), screen.polarization, screen.subband)
        maxima = local_maxima(chosen, screen.radius)
        y = self.grid.y[section.rows]
        own = maxima[(maxima["y"] >= y[0]) & (maxima["y"] <= y[-1])].reset_index(drop=True)
        seen = np.count_nonzero(np.isfinite(chosen.values[self._own]))
        return {**self._cropped(values, looks), "seen": np.array(seen), **table_arrays(own, "maximum.")}

    def _evidence_part(self, block: range, places: Places) -> Arrays:
        before, sums, cleaned = self._window(block), self._evidence_sums(self._poses_near(block)), self.cleaned

        def gathered() -> Arrays:
            return {**before.sums(), **named("evidence", sums.sums())}

        def take(kept: Arrays) -> None:
            before.take(kept)
            sums.take(under(kept, "evidence"))

        for place in places(block, take, gathered):
            image = cleaned.imager.image(int(cleaned.imager.scans[place]))
            before.add(np.abs(image.values), cleaned.grid, np.asarray(image.attrs["pose"]))
            sums.add(image.copy(data=cleaned.background.own_coherent(image.values, cleaned.gains[place])))
        return gathered()

    def _evidence_result(self, parts: Iterable[Arrays]) -> Arrays:
        before, sums = RunViewSums(self.grid, self.recipe.run_view.y_max, self._kept), self._evidence_sums()
        for part in parts:
            before.take(part)
            sums.take(under(part, "evidence"))
        return {**self._cropped(*before.result()), **named("evidence", sums.sums())}

    def _evidence_sums(self, poses: Mapping[int, NDArray[np.float64]] | None = None) -> EvidenceSums:
        contrast, alarms = self.recipe.contrast, self.found().ranked()[0]
        return EvidenceSums(alarms, contrast.patch(), self.recipe.run_view.y_max, self.run, contrast.subband, poses)

    def _poses_near(self, block: range) -> dict[int, NDArray[np.float64]]:
        """Give the poses of all scans that may see what a scan of the block sees."""
        scans, every = self.imager.scans, self.run["pose"].values
        farthest = float(np.abs(self.cleaned.grid.extent()).max()) * np.sqrt(2)
        y = every[scans[block.start : block.stop], 1]
        near = (every[scans, 1] >= y.min() - 2 * farthest) & (every[scans, 1] <= y.max() + 2 * farthest)
        return {int(scan): every[scan] for scan in scans[near]}

    def _rows(self, block: range) -> slice:
        """Tell which of the kept rows of the lane a block reaches."""
        sums, grid = RunViewSums(self.grid, self.recipe.run_view.y_max, slice(0, 0)), cleaned_grid(self.recipe)
        poses = self.run["pose"].values[self.imager.scans[block.start : block.stop]]
        rows = [sums.reach(grid, pose) for pose in poses]
        begin = max(min(row.start for row in rows), self._kept.start)
        return slice(begin, max(min(max(row.stop for row in rows), self._kept.stop), begin))

    def _window(self, block: range) -> RunViewSums:
        return RunViewSums(self.grid, self.recipe.run_view.y_max, self._rows(block))

    @property
    def _own(self) -> slice:
        """The section's own rows among those that are kept."""
        return slice(self.section.start - self._kept.start, self.section.stop - self._kept.start)

    def _cropped(self, values: NDArray[np.float32], looks: NDArray[np.int64]) -> Arrays:
        return {"view": values[..., self._own, :], "looks": looks[self._own]}

    def _as_view(self, values: NDArray[np.float32], looks: NDArray[np.int64], rows: slice) -> xr.DataArray:
        labels = {"polarization": self.run["polarization"].values, "subband": list(self.recipe.image.subbands)}
        return view_array(values, looks, self.grid, labels, rows)


def table_arrays(table: pd.DataFrame, prefix: str = "") -> Arrays:
    """Take a table of numbers apart into one array per column.

    Parameters
    ----------
    table : DataFrame
        Numbers with a plain index.
    prefix : str
        What to put before the names.

    Returns
    -------
    dict of ndarray
        The columns.
    """
    return {f"{prefix}{name}": table[name].to_numpy() for name in table.columns}


def array_table(arrays: Mapping[str, NDArray[Any]], prefix: str = "") -> pd.DataFrame:
    """Put a table together again.

    Parameters
    ----------
    arrays : mapping of str to ndarray
        From :func:`table_arrays`, among others.
    prefix : str
        What the names of its columns begin with.

    Returns
    -------
    DataFrame
        The table.
    """
    return pd.DataFrame({key.removeprefix(prefix): arrays[key] for key in arrays if key.startswith(prefix)})


def _prefixes(part: Arrays) -> list[str]:
    return list(dict.fromkeys(key.rpartition("|")[0] for key in part))
