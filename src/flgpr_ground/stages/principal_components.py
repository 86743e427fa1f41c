"""A map by the likelihood of principal components, look by look (after Kositsky et al. 2002).

See :mod:`flgpr_ground.detect.principal_components` for what of the paper could be read.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import Any, ClassVar

import numpy as np
import pandas as pd
import xarray as xr
from pydantic import model_validator

from flgpr.clutter import ClutterWhitener
from flgpr.detect import LinearQuadraticForm, PrincipalComponentDetector
from flgpr.engine import Accumulator, append_accumulator
from flgpr.features import clean_pixels, clutter_cuts, stack_channels
from flgpr.model import ground_points, lane_to_scan
from flgpr.stages import Positive, Table
from flgpr.stages.forms import (
    MOST_FORMS,
    FormMap,
    SampleSettings,
    learnt_arrays,
    target_cuts,
)
from flgpr.stages.too_few import Change, Tally, TooFewExamplesError, clear_change
from flgpr.types import AnyArray, Arrays, Entries, Float32Array, FloatArray


class ComponentSettings(SampleSettings):
    """Range cuts, how training samples are taken, and the intervals of range.

    A scan looks at a place from the interval between two of the ``edges`` (m ahead of the array)
    in which it lies; every interval has components of its own. ``rank`` is their number. The other
    entries mean what they mean for the map "deflection".
    """

    edges: tuple[Positive, ...] = (7.5, 12.5, 17.5, 22.5)

    @model_validator(mode="after")
    def _increasing(self) -> ComponentSettings:
        """Refuse edges that make no intervals, or more than a map has forms."""
        if not 2 <= len(self.edges) <= MOST_FORMS + 1 or (np.diff(self.edges) <= 0).any():
            raise ValueError(
                f"edges must increase and be 2 to {MOST_FORMS + 1}, got {list(self.edges)}"
            )
        return self


class ComponentMap(FormMap):
    """The log-likelihood ratio of the principal components of mines, by intervals of range.

    Cuts are whitened by the clutter of their interval. With the look "mean" of the run-view, the
    ratios of all scans that see a place are averaged: up to their number that is the likelihood
    ratio of all looks. The map counts from the least ratio on clutter, in standard deviations of
    the ratios there.
    """

    Settings: ClassVar[type[Table]] = ComponentSettings

    @classmethod
    def _form_count(cls, settings: Any) -> int:
        """Return the number of intervals."""
        return len(settings.edges) - 1

    def map(self, image: xr.DataArray) -> Float32Array:
        """Return the log-likelihood ratio about every pixel (y, x); NaN beyond the edges."""
        stack, _ = stack_channels(image.isel(subband=0, drop=True), self.settings.polarizations)
        ratio = np.full(stack.shape[1:], np.nan, np.float32)
        y = image["y"].values
        before = self.settings.length // 2
        after = self.settings.length - before - 1
        for form, interval in zip(self.forms, pairwise(self.settings.edges), strict=True):
            first, end = np.searchsorted(y, interval)
            # The chips of the interval's pixels reach beyond it.
            begin = max(first - before, 0)
            of_interval = form.likelihood(stack[:, begin : end + after], self._chip)
            ratio[first:end] = of_interval[first - begin : end - begin]
        least, deviation = self.learnt["clutter"]
        return np.asarray((ratio - least) / deviation, dtype=np.float32)

    def examples(self, truth: pd.DataFrame, image: Callable[[int], xr.DataArray]) -> Accumulator:
        """Return what gathers cuts at mines and of clutter, interval by interval."""
        surveyed = ground_points(truth)
        pieces: list[Arrays] = []

        def add(index: int) -> None:
            mines = lane_to_scan(surveyed, self.setup.pose(index))[:, :2]
            band = image(index).isel(subband=0, drop=True)
            pieces.append(interval_samples(band, mines, self.settings))

        return append_accumulator(pieces, add)

    @classmethod
    def fit(cls, settings: Any, examples: list[Any]) -> tuple[Arrays, Entries]:
        """Learn, for each interval, what whitens its clutter, and the components of the mines."""
        forms = []
        on_clutter = []
        looks = []
        for number, interval in enumerate(pairwise(settings.edges)):
            target, clutter = (
                np.concatenate([lane[f"{part}-{number}"] for lane in examples])
                for part in ("target", "clutter")
            )
            forms.append(_trained(settings, interval, target, clutter))
            on_clutter.append(forms[-1](clutter))
            looks.append(len(target))
        value = np.concatenate(on_clutter)
        learnt = learnt_arrays(forms, value)
        return learnt, {"looks_at_mines": looks, "clutter_samples": len(value)}


def interval_samples(band: xr.DataArray, mines: FloatArray, settings: ComponentSettings) -> Arrays:
    """Take range cuts at mines, and of the clutter away from them, in each interval of range.

    A mine's cut may reach beyond the interval in which the mine lies, a cut of clutter may not: its
    moments are those of the interval. So the image cannot be cut into intervals first, and
    :func:`~flgpr.stages.forms.samples_at`, which takes both from one image, serves the map
    "deflection" alone.

    Parameters
    ----------
    band : (polarization, y, x) DataArray of complex
        One sub-band of a cleaned scan image.
    mines : (mine, 2) ndarray
        x and y in the scan frame, m.
    settings : ComponentSettings
        How samples are taken.

    Returns
    -------
    dict of str to ndarray
        ``target-k`` and ``clutter-k``, (sample, feature) cuts whose middle lies in interval k.
    """
    shape = settings.length, 1
    samples = {}
    clean = clean_pixels(band["x"].values, band["y"].values, mines, settings.clear)
    for number, (nearest, farthest) in enumerate(pairwise(settings.edges)):
        of_interval = mines[(mines[:, 1] >= nearest) & (mines[:, 1] < farthest)]
        samples[f"target-{number}"] = target_cuts(band, of_interval, settings)

        rows = slice(*np.searchsorted(band["y"].values, [nearest, farthest]))
        stack, _ = stack_channels(band.isel(y=rows), settings.polarizations)
        of_clutter = clutter_cuts(stack, clean[rows], shape, settings.clutter_step)
        samples[f"clutter-{number}"] = of_clutter
    return samples


def _trained(
    settings: ComponentSettings,
    interval: tuple[float, float],
    target: AnyArray,
    clutter: AnyArray,
) -> LinearQuadraticForm:
    """Return the log-likelihood ratio of an interval, or refuse too few looks or samples."""
    nearest, farthest = interval
    span = f"from {nearest:g} to {farthest:g} m"
    counts = [
        Tally(len(target), f"looks at targets {span}"),
        Tally(len(clutter), "cuts of clutter there"),
    ]
    if len(target) < 2:
        needed = f"2 looks at targets or more {span}, got {len(target)}"
        ends = [settings.edges[0], settings.edges[-1]]
        one_interval = Change("edges", ends, list(settings.edges))
        changes = [one_interval] if len(settings.edges) > 2 else []
        raise TooFewExamplesError(needed, counts, changes)
    if len(clutter) < 2:
        needed = f"2 cuts of clutter or more {span}, got {len(clutter)}"
        raise TooFewExamplesError(needed, counts, [clear_change(settings)])
    try:
        whitener = ClutterWhitener(settings.moments).fit(clutter)
    except ValueError as error:
        shrunk = Change("moments", "ledoit-wolf", settings.moments)
        raise TooFewExamplesError(
            f"samples that moments can be taken of: {error}", counts, [shrunk]
        ) from None
    trained = PrincipalComponentDetector(settings.rank).fit(whitener.transform(target))
    return trained.forms_[0].after(whitener.mean_, whitener.matrix_)
