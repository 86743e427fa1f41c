"""Patterns in the patch of the run-view about an alarm: HOG, LBP, visual words, Fisher vectors.

Camilo, Collins & Malof ("A Large Comparison of Feature-Based Approaches for Buried Target
Classification in Forward-Looking Ground-Penetrating Radar", IEEE Trans. Geoscience and Remote
Sensing 56(1), 2018) compare such features of images at a prescreener's alarms. What of their work
could be read is in docs/evidence/patch-features.md, and what is assumed here.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Annotated, Any, ClassVar, Literal, NamedTuple

import numpy as np
import xarray as xr
from pydantic import Field, model_validator

from flgpr.detect.scorers.checks import Checked
from flgpr.features import cut_regions
from flgpr.model import Grid
from flgpr.screen import select
from flgpr.screen.views import grid_of
from flgpr.stages import FeatureStage, Positive, Setup, Table, TrainingView
from flgpr.stages.too_few import Change, Tally, TooFewExamplesError
from flgpr.types import Arrays, Entries, FloatArray, floats
from flgpr_ground.features.dictionaries import (
    Mixture,
    Whitening,
    fisher_vectors,
    improved_fisher_vectors,
    learn_mixture,
    learn_whitening,
    learn_words,
    word_histograms,
)
from flgpr_ground.features.patch_descriptors import (
    LOCAL_BINS,
    LOCAL_CELLS,
    gradient_windows,
    hog,
    lbp_histograms,
    normalize_by_border,
    pixel_windows,
    split_grid,
)
from flgpr_ground.stages.run_views import maxima_in_lane

_BATCH = 128  # patches that are described at once
_KNOWN_SHARE = 0.999  # a cut pixel counts as seen if this much of what it was interpolated from was
_MIXTURE = ("share", "centre", "deviation")  # arrays of a learnt mixture, in the order of Mixture
_SHARE_TOLERANCE = 1e-6  # of the sum of a mixture's weights


class PatchSettings(Table):
    """The patch about an alarm, and its channels."""

    size: tuple[Positive, Positive] = (2.5, 2.5)  #: width and length, m
    polarizations: tuple[str, ...] = ()  #: by default all of the run-view
    subband: str | None = None  #: by default the first


class HogSettings(PatchSettings):
    """Histograms of oriented gradients."""

    cell: Positive = 0.8  #: edge of a cell, m
    block: Annotated[int, Field(ge=1, le=16)] = 2  #: cells of a block each way
    bins: Annotated[int, Field(ge=2, le=36)] = 9  #: directions


class LbpSettings(PatchSettings):
    """Histograms of local binary patterns."""

    parts: Annotated[int, Field(ge=1, le=16)] = 3  #: histograms of a patch each way


class DictionarySettings(PatchSettings):
    """Local descriptors of windows, and how many of them teach."""

    #: what describes a window, of all polarizations together: its pixels, or histograms of its
    #: gradients
    local: Literal["pixels", "gradients"] = "pixels"
    window: Positive = 0.7  #: width and length of a window, m
    step: Positive = 0.2  #: from one window to the next, m
    directions: Annotated[int, Field(ge=1, le=512)] = 32  #: principal directions of descriptors
    parts: Annotated[int, Field(ge=1, le=8)] = 2  #: pools of a patch each way
    radius: Positive = 0.75  #: distance of the maxima of training lanes whose patches teach, m
    most: Annotated[int, Field(ge=1, le=200_000)] = 20_000  #: windows that teach
    seed: Annotated[int, Field(ge=0, le=2**32 - 1)] = 0

    @model_validator(mode="after")
    def _fits(self) -> DictionarySettings:
        """Refuse a window that the patch does not hold."""
        if self.window > min(self.size):
            raise ValueError(f"window must be at most size {self.size}, got {self.window:g}")
        return self


class WordSettings(DictionarySettings):
    """Local descriptors, and the size of the dictionary."""

    words: Annotated[int, Field(ge=2, le=4096)] = 200  #: visual words of the dictionary


class FisherSettings(DictionarySettings):
    """Local descriptors, and the size of the mixture."""

    local: Literal["pixels", "gradients"] = "gradients"
    window: Positive = 1.2
    directions: Annotated[int, Field(ge=1, le=512)] = 16
    gaussians: Annotated[int, Field(ge=1, le=256)] = 30


class _Channels(NamedTuple):
    """The channels of a run-view that patches show."""

    polarizations: list[str]
    values: FloatArray  #: (polarization, y, x) magnitudes, zero where nothing was seen
    has_value: FloatArray  #: (polarization, y, x) 1 where a magnitude is, else 0
    grid: Grid

    @classmethod
    def of(cls, view: xr.DataArray, settings: Any) -> _Channels:
        """Return the channels of a run-view that settings name; others are a ValueError."""
        subband = settings.subband or str(view["subband"].values[0])
        labels = [str(label) for label in view["polarization"].values]
        polarizations = list(settings.polarizations) or labels
        values = np.stack([select(view, label, subband).values for label in polarizations])
        known = np.isfinite(values)
        magnitudes = floats(np.where(known, values, 0.0))
        return cls(polarizations, magnitudes, floats(known), grid_of(view))

    def patches(self, points: FloatArray, size: tuple[float, float]) -> FloatArray:
        """Cut normalised patches (point, polarization, v, u) about points (point, 2)."""
        magnitudes = cut_regions(self.values, self.grid, points, size)
        # Interpolated like the magnitudes: less than one next to a pixel without one.
        share_known = cut_regions(self.has_value, self.grid, points, size)
        return normalize_by_border(magnitudes, share_known > _KNOWN_SHARE)


class PatchStage(FeatureStage):
    """Columns that describe the patch of the run-view about an alarm.

    Magnitudes are in units of the deviation of the patch's border, off its mean
    (:func:`flgpr_ground.features.patch_descriptors.normalize_by_border`). The looks at a place are those
    that the run-view has combined. Columns are named after a part of the patch and a number in it,
    such as ``hog_HH_017``.
    """

    prefix: ClassVar[str] = ""
    digits: ClassVar[int] = 0  #: of the number in a part; 0 for as many as the largest needs

    @classmethod
    def margin(cls, settings: Any) -> float:
        """Return how far a patch reaches, m."""
        return float(settings.size[1])

    def of_view(self, view: xr.DataArray, points: FloatArray) -> Mapping[str, FloatArray]:
        """Cut the patches of the alarms and describe them."""
        channels = _Channels.of(view, self.settings)
        parts = self._parts(channels)
        columns = self.column_count(self.settings, len(channels.polarizations), channels.grid)
        table = np.zeros((columns, len(points)))
        for begin in range(0, len(points), _BATCH):
            batch = slice(begin, begin + _BATCH)
            patches = channels.patches(points[batch], self.settings.size)
            table[:, batch] = self._describe(patches, channels.grid.dx).T
        count = columns // len(parts)
        digits = self.digits or len(str(count - 1))
        numbers = [f"{number:0{digits}d}" for number in range(count)]
        names = [f"{self.prefix}_{part}_{number}" for part in parts for number in numbers]
        return dict(zip(names, table, strict=True))

    def _parts(self, channels: _Channels) -> Sequence[Any]:
        """Return the parts in the order of their columns; refuse a run-view that does not fit."""
        raise NotImplementedError

    def _describe(self, patches: FloatArray, spacing: float) -> FloatArray:
        """Return the features (patch, column) of patches (patch, polarization, v, u).

        ``spacing`` is that of their pixels, m.
        """
        raise NotImplementedError


class _StaticPatterns(PatchStage):
    """Descriptors of each polarization by itself, which need no training."""

    digits = 3

    @classmethod
    def column_count(cls, settings: Any, polarizations: int, view: Grid) -> int:
        """Return how many columns all polarizations have."""
        corner = np.array([[view.x_min, view.y_min]])
        patch = cut_regions(np.zeros((1, 1, 1)), view, corner, settings.size)
        of_one = cls._descriptors(patch, settings, view.dx).size
        return (len(settings.polarizations) or polarizations) * of_one

    @classmethod
    def _descriptors(cls, patches: FloatArray, settings: Any, spacing: float) -> FloatArray:
        """Return the descriptors (patch, polarization, component) of patches."""
        raise NotImplementedError

    def _parts(self, channels: _Channels) -> Sequence[Any]:
        """Return the polarizations."""
        return channels.polarizations

    def _describe(self, patches: FloatArray, spacing: float) -> FloatArray:
        """Return the descriptors, of each polarization by itself."""
        return self._descriptors(patches, self.settings, spacing).reshape(len(patches), -1)


class Hog(_StaticPatterns):
    """The columns ``hog_*``: histograms of oriented gradients (Dalal & Triggs 2005)."""

    prefix = "hog"
    Settings: ClassVar[type[Table]] = HogSettings

    @classmethod
    def _descriptors(cls, patches: FloatArray, settings: Any, spacing: float) -> FloatArray:
        """Return the histograms of gradients."""
        return hog(patches, max(round(settings.cell / spacing), 1), settings.block, settings.bins)


class Lbp(_StaticPatterns):
    """The columns ``lbp_*``: histograms of local binary patterns (Ojala et al. 2002)."""

    prefix = "lbp"
    Settings: ClassVar[type[Table]] = LbpSettings

    @classmethod
    def _descriptors(cls, patches: FloatArray, settings: Any, _spacing: float) -> FloatArray:
        """Return the histograms of patterns."""
        return lbp_histograms(patches, settings.parts)


class _LearntPatterns(PatchStage):
    """Features by a dictionary of local descriptors, learnt without labels."""

    learns = True
    size_entry: ClassVar[str] = ""  #: entry of the recipe that is the dictionary's size

    @classmethod
    def fit(cls, settings: Any, examples: list[TrainingView]) -> tuple[Arrays, Entries]:
        """Learn principal directions and a dictionary from patches of the training lanes.

        Labels are not looked at.
        """
        patches, windows = _windows_of_lanes(examples, settings)
        entries = getattr(settings, cls.size_entry)
        least = max(entries, 2)
        if len(windows) < least:
            counts = [
                Tally(patches, "patches at local maxima"),
                Tally(len(windows), "windows that teach"),
            ]
            changes = [Change(cls.size_entry, len(windows), entries)] if len(windows) >= 2 else []
            needed = f"{least} windows or more, got {len(windows)}"
            raise TooFewExamplesError(needed, counts, changes)
        whitening = learn_whitening(windows, min(settings.directions, windows.shape[1]))
        learnt: Arrays = {"mean": whitening.mean, "projection": whitening.projection}
        learnt |= cls._dictionary(whitening(windows), settings)
        return learnt, {"patches": patches, "windows": len(windows)}

    @classmethod
    def _dictionary(cls, descriptors: FloatArray, settings: Any) -> Arrays:
        """Learn the dictionary from whitened descriptors (n, direction)."""
        raise NotImplementedError

    @classmethod
    def check_learnt(cls, settings: Any, setup: Setup, learnt: Checked) -> None:
        """Check the principal directions, of local descriptors of this recipe's windows."""
        of_one = _components(settings, setup.view.dx)
        components = len(learnt.array("mean", (None,)))
        most = len(settings.polarizations) or max(len(setup.imaged), 1)
        if components % of_one or not of_one <= components <= most * of_one:
            raise ValueError(
                f"array 'mean' must have {of_one} components of each of 1 to {most} polarizations, "
                f"got {components}"
            )
        directions = min(settings.directions, components)
        learnt.array("projection", (directions, components))
        cls._check_dictionary(settings, directions, learnt)

    @classmethod
    def _check_dictionary(cls, settings: Any, directions: int, learnt: Checked) -> None:
        """Check the arrays of the dictionary."""
        raise NotImplementedError

    def _parts(self, channels: _Channels) -> Sequence[Any]:
        """Return the pools; refuse other polarizations than those of the training lanes."""
        of_one = _components(self.settings, channels.grid.dx)
        components = len(self.learnt["mean"])
        if components != of_one * len(channels.polarizations):
            raise ValueError(
                f"model must have been trained on {len(channels.polarizations)} polarizations of "
                f"{of_one} components, as this run-view has, got {components} components"
            )
        return range(self.settings.parts**2)

    def _local(self, patches: FloatArray, spacing: float) -> FloatArray:
        """Return the descriptors (patch, row, column, direction) of the windows of patches."""
        whitening = Whitening(self.learnt["mean"], self.learnt["projection"])
        return whitening(_windows(patches, self.settings, spacing))


class VisualWords(_LearntPatterns):
    """The columns ``word_*``: the bag of visual words of each pool of a patch.

    They are square roots of the shares of its windows that are nearest to each word, the centres of
    k-means (:func:`flgpr_ground.features.dictionaries.word_histograms`).
    """

    prefix = "word"
    size_entry = "words"
    Settings: ClassVar[type[Table]] = WordSettings

    @classmethod
    def column_count(cls, settings: Any, _polarizations: int, _view: Grid) -> int:
        """Return how many words all pools have."""
        return int(settings.parts**2 * settings.words)

    @classmethod
    def _dictionary(cls, descriptors: FloatArray, settings: Any) -> Arrays:
        """Learn the words."""
        return {"words": learn_words(descriptors, settings.words, settings.seed)}

    @classmethod
    def _check_dictionary(cls, settings: Any, directions: int, learnt: Checked) -> None:
        """Check the words."""
        learnt.array("words", (settings.words, directions))

    def _describe(self, patches: FloatArray, spacing: float) -> FloatArray:
        """Return the histograms of all pools."""
        local = self._local(patches, spacing)
        histograms = word_histograms(local, self.learnt["words"], self.settings.parts)
        return histograms.reshape(len(patches), -1)


class FisherVectors(_LearntPatterns):
    """The columns ``fisher_*``: the improved Fisher vector of each pool of a patch.

    They say how its windows would change the means and deviations of a mixture of Gaussians
    (Perronnin, Sánchez & Mensink 2010; :func:`flgpr_ground.features.dictionaries.fisher_vectors`).
    """

    prefix = "fisher"
    size_entry = "gaussians"
    Settings: ClassVar[type[Table]] = FisherSettings

    @classmethod
    def column_count(cls, settings: Any, polarizations: int, view: Grid) -> int:
        """Return how many components the vectors of all pools have."""
        shown = len(settings.polarizations) or polarizations
        directions = min(settings.directions, shown * _components(settings, view.dx))
        return int(settings.parts**2 * 2 * settings.gaussians * directions)

    @classmethod
    def _dictionary(cls, descriptors: FloatArray, settings: Any) -> Arrays:
        """Learn the mixture."""
        mixture = learn_mixture(descriptors, settings.gaussians, settings.seed)
        return dict(zip(_MIXTURE, mixture, strict=True))

    @classmethod
    def _check_dictionary(cls, settings: Any, directions: int, learnt: Checked) -> None:
        """Check the mixture."""
        by_direction = (settings.gaussians, directions)
        share = learnt.array("share", (settings.gaussians,))
        learnt.array("centre", by_direction)
        deviation = learnt.array("deviation", by_direction)
        for name, values in (("share", share), ("deviation", deviation)):
            if not (values > 0).all():
                raise ValueError(f"array {name!r} must be positive, got {values.min():g}")
        if abs(share.sum() - 1) > _SHARE_TOLERANCE:
            raise ValueError(f"array 'share' must add up to 1, got {share.sum():g}")

    def _describe(self, patches: FloatArray, spacing: float) -> FloatArray:
        """Return the vectors of all pools."""
        local = self._local(patches, spacing)
        mixture = Mixture(*(self.learnt[name] for name in _MIXTURE))
        pools = [
            improved_fisher_vectors(fisher_vectors(pool, mixture))
            for pool in split_grid(local, self.settings.parts)
        ]
        return np.concatenate(pools, axis=1)


def _window_pixels(settings: DictionarySettings, spacing: float) -> int:
    """Return the pixels of a window each way; those of gradients are a multiple of four."""
    cells = 1 if settings.local == "pixels" else LOCAL_CELLS
    return cells * max(round(settings.window / (cells * spacing)), 1)


def _components(settings: DictionarySettings, spacing: float) -> int:
    """Return the components of a local descriptor of one polarization."""
    if settings.local == "gradients":
        return LOCAL_CELLS**2 * LOCAL_BINS
    return _window_pixels(settings, spacing) ** 2


def _windows(patches: FloatArray, settings: DictionarySettings, spacing: float) -> FloatArray:
    """Return the windows (patch, row, column, component) of patches before whitening."""
    size = _window_pixels(settings, spacing)
    step = max(round(settings.step / spacing), 1)
    if settings.local == "gradients":
        return gradient_windows(patches, size, step)
    return pixel_windows(patches, size, step)


def _windows_of_lanes(
    examples: list[TrainingView], settings: DictionarySettings
) -> tuple[int, FloatArray]:
    """Draw windows from patches of lanes, as many of every lane, at most ``most`` in all.

    Returns
    -------
    patches : int
        Number of patches.
    windows : (n, component) ndarray
        The windows.
    """
    rng = np.random.default_rng(settings.seed)
    drawn = [np.zeros((0, 1))]
    patches = 0
    for lane in examples:
        channels = _Channels.of(lane.view, settings)
        magnitudes = np.maximum(channels.values, np.finfo(np.float32).tiny)
        level = np.where(channels.has_value > 0, np.log(magnitudes), np.nan).mean(axis=0)
        places = maxima_in_lane(lane, level, settings.radius)
        patches += len(places)
        of_lane = max(settings.most // len(examples), 1)
        for begin in range(0, len(places), _BATCH):
            batch = places[begin : begin + _BATCH]
            cut = channels.patches(batch, settings.size)
            windows = _windows(cut, settings, channels.grid.dx)
            windows = windows.reshape(-1, windows.shape[-1])
            # Whole numbers, so that the batches of a lane add up to no more than it may give.
            of_batch = of_lane * len(batch) // len(places)
            chosen = rng.permutation(len(windows))[:of_batch]
            drawn.append(windows[np.sort(chosen)])
    return patches, np.concatenate(drawn[1:] or drawn)
