"""The chain of Wang et al. 2007 for runs of any length: passes over the scans that hold one scan at a time."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

from flgpr.clutter import Background, BackgroundEstimator
from flgpr.features import POLARIMETRIC, FeatureSettings, FeatureSums
from flgpr.imaging import ScanImager
from flgpr.model import ALARM_COLUMNS, Grid, empty_table
from flgpr.pipeline.progress import Track
from flgpr.pipeline.recipe import FeaturesTable, Recipe

SWAPPED, PAPER = "swapped.", "paper."
"""Prefixes of the columns of the two variants."""
BLOCK = 16
"""Most scans in a block."""
Arrays = dict[str, NDArray[Any]]
FloatArray = NDArray[np.float64]
Places = Callable[[range, Callable[[Arrays], None], Callable[[], Arrays]], Iterator[int]]
"""Goes through a block: takes it, what takes in sums that were kept, and what gives sums to keep."""


def plainly(block: range, take: Callable[[Arrays], None], sums: Callable[[], Arrays]) -> Iterator[int]:  # noqa: ARG001
    """Go through a block from its beginning and keep nothing.

    Parameters
    ----------
    block : range
        The block.
    take, sums : callable
        Not called.

    Yields
    ------
    int
        Its scans.
    """
    yield from block


def blocks_of(scans: int) -> list[range]:
    """Divide scans into blocks of at most ``BLOCK`` consecutive ones, as even as can be.

    Sums over a run are sums over the blocks' sums, in the order of the blocks, so that they have the same bits wherever
    and in whatever order the blocks are worked on.

    Parameters
    ----------
    scans : int
        Number of scans.

    Returns
    -------
    list of range
        The blocks.
    """
    count = -(-scans // BLOCK)
    edges = [scans * k // count for k in range(count + 1)]
    return [range(begin, end) for begin, end in pairwise(edges)]


@dataclass(frozen=True)
class Found:
    """What the chain found in a run.

    Attributes
    ----------
    alarms : DataFrame
        x, y, magnitude, confidence, scans.
    features : DataFrame
        Their features, with the same index.
    view : xarray.DataArray
        Run-view (polarization, subband, y, x).
    notes : dict
        Figures worth reporting.
    """

    alarms: pd.DataFrame
    features: pd.DataFrame
    view: xr.DataArray
    notes: dict[str, Any]

    def ranked(self) -> tuple[pd.DataFrame, pd.DataFrame]:
        """Give alarms and features from the most mine-like down, without those that have no confidence."""
        return ranked(self.alarms, self.features)


def ranked(alarms: pd.DataFrame, features: pd.DataFrame) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Drop alarms without a confidence, sort the rest, name them, and keep their features in step.

    Parameters
    ----------
    alarms, features : DataFrame
        Alarms with ``confidence`` and their features, with the same index.

    Returns
    -------
    DataFrame, DataFrame
        Alarm table with ``alarm_id``, the highest confidence first, and the features in the same order.
    """
    table = alarms[alarms["confidence"].notna()].sort_values("confidence", ascending=False, kind="stable")
    features = features.loc[table.index].reset_index(drop=True)
    table = table.reset_index(drop=True)
    table["alarm_id"] = [f"alarm-{i + 1}" for i in range(len(table))]
    known = [column.name for column in ALARM_COLUMNS if column.name in table.columns]
    return (table[known] if len(table) else empty_table(ALARM_COLUMNS)[known]), features


def whole_imager(run: xr.Dataset, recipe: Recipe) -> ScanImager:
    """Make the imager of a run's whole scan images.

    Parameters
    ----------
    run : xarray.Dataset
        A run.
    recipe : Recipe
        The recipe.

    Returns
    -------
    ScanImager
        Its images.
    """
    table = recipe.image
    return ScanImager(run, table.grid(), table.subbands, table.window, table.tolerance)


def cleaned_grid(recipe: Recipe) -> Grid:
    """Give the pixels of cleaned images, which end at the distance that counts.

    Parameters
    ----------
    recipe : Recipe
        The recipe.

    Returns
    -------
    Grid
        The nearest rows of the whole images.
    """
    table, whole = recipe.image, recipe.image.grid()
    reach = recipe.run_view.y_max + recipe.contrast.size * recipe.contrast.spacing / 2 + table.spacing
    rows = min(whole.ny, int(np.ceil((reach - whole.y_min) / whole.dy)) + 1)
    return Grid(whole.x_min, whole.y_min, whole.nx, rows, whole.dx, whole.dy)


def estimator(recipe: Recipe) -> BackgroundEstimator:
    """Make the estimator of a recipe's background.

    Parameters
    ----------
    recipe : Recipe
        The recipe.

    Returns
    -------
    BackgroundEstimator
        It has seen nothing yet.
    """
    median, mean = recipe.background.windows(recipe.image.spacing)
    return BackgroundEstimator(median, mean, recipe.background.median_step)


def signature_part(imager: ScanImager, recipe: Recipe, block: range, places: Places = plainly) -> Arrays:
    """First pass over a block: what it adds to the self-signature.

    Parameters
    ----------
    imager : ScanImager
        Whole scan images.
    recipe : Recipe
        The recipe.
    block : range
        Places of its scans among the imager's.
    places : Places
        Goes through the block.

    Returns
    -------
    dict of ndarray
        See :meth:`flgpr.clutter.BackgroundEstimator.first_sums`.
    """
    tool = estimator(recipe)
    for place in places(block, tool.take_first, lambda: tool.first_sums(exact=True)):
        tool.add_signature(imager.image(int(imager.scans[place])).values)
    return tool.first_sums()


def signature_of(recipe: Recipe, parts: Iterable[Arrays]) -> Arrays:
    """Fold the first pass.

    Parameters
    ----------
    recipe : Recipe
        The recipe.
    parts : iterable of dict of ndarray
        All blocks' parts in order.

    Returns
    -------
    dict of ndarray
        See :meth:`flgpr.clutter.BackgroundEstimator.first_result`.
    """
    tool = estimator(recipe)
    for part in parts:
        tool.take_first(part)
    return tool.first_result()


def gain_part(imager: ScanImager, recipe: Recipe, block: range, first: Arrays, places: Places = plainly) -> Arrays:
    """Second pass over a block: what it adds to the gain background.

    Parameters
    ----------
    imager : ScanImager
        Whole scan images.
    recipe : Recipe
        The recipe.
    block : range
        Places of its scans among the imager's.
    first : dict of ndarray
        From :func:`signature_of`.
    places : Places
        Goes through the block.

    Returns
    -------
    dict of ndarray
        See :meth:`flgpr.clutter.BackgroundEstimator.second_sums`.
    """
    tool = estimator(recipe)
    tool.continue_from(first, slice(block.start, block.stop))
    for place in places(block, tool.take_second, tool.second_sums):
        tool.add_gain(imager.image(int(imager.scans[place])).values)
    return tool.second_sums()


def background_of(recipe: Recipe, parts: Iterable[Arrays], first: Arrays) -> Arrays:
    """Fold the second pass.

    Parameters
    ----------
    recipe : Recipe
        The recipe.
    parts : iterable of dict of ndarray
        All blocks' parts in order.
    first : dict of ndarray
        From :func:`signature_of`.

    Returns
    -------
    dict of ndarray
        ``gains`` (scan, polarization, subband) and the attributes of :class:`flgpr.clutter.Background`.
    """
    tool = estimator(recipe)
    tool.continue_from(first)
    for part in parts:
        tool.take_second(part)
    return {"gains": first["gains"]} | vars(tool.result())


class CleanedRun:
    """A run's cleaned images, made anew on every pass.

    Two passes estimate the background when the object is made, unless it is given; each iteration is one more. Images
    end at the distance that counts, so that later passes make only what they need.

    Parameters
    ----------
    run : xarray.Dataset
        A run.
    recipe : Recipe
        Recipe with the table features.
    track : Track
        Shows progress.
    background : dict of ndarray, optional
        From :func:`background_of`, where it is known already.
    """

    def __init__(
        self, run: xr.Dataset, recipe: Recipe, track: Track, background: Mapping[str, NDArray[Any]] | None = None
    ) -> None:
        table = recipe.image
        if background is None:
            imager = whole_imager(run, recipe)
            blocks = blocks_of(len(imager))
            done = track(blocks, "self-signature", len(blocks))
            first = signature_of(recipe, (signature_part(imager, recipe, block) for block in done))
            done = track(blocks, "gain background", len(blocks))
            background = background_of(recipe, (gain_part(imager, recipe, block, first) for block in done), first)
        self.gains: FloatArray = background["gains"]
        self.grid = cleaned_grid(recipe)
        self.imager = ScanImager(run, self.grid, table.subbands, table.window, table.tolerance)
        self.whole_background = Background(**{name: background[name] for name in background if name != "gains"})
        self.background: Background = self.whole_background.cropped(self.grid.ny)

    def __len__(self) -> int:
        return len(self.imager)

    def __iter__(self) -> Iterator[tuple[NDArray[np.complex64], FloatArray, FloatArray]]:
        """Yield every scan's image, gains and pose."""
        yield from self.scans(range(len(self)))

    def scans(self, block: Iterable[int]) -> Iterator[tuple[NDArray[np.complex64], FloatArray, FloatArray]]:
        """Go through a block.

        Parameters
        ----------
        block : iterable of int
            Places of its scans among the complete ones.

        Yields
        ------
        tuple
            Every scan's image, gains and pose.
        """
        for place in block:
            image = self.imager.image(int(self.imager.scans[place]))
            yield image.values, self.gains[place], np.asarray(image.attrs["pose"])


def feature_sums(cleaned: CleanedRun, run: xr.Dataset, recipe: Recipe, alarms: pd.DataFrame) -> dict[str, FeatureSums]:
    """Make the sums that the features of alarms and their variants are gathered in.

    Parameters
    ----------
    cleaned : CleanedRun
        The run's cleaned images.
    run : xarray.Dataset
        The run.
    recipe : Recipe
        Recipe with the table features.
    alarms : DataFrame
        x, y in the lane frame, m.

    Returns
    -------
    dict of str to FeatureSums
        By prefix; "" for the features themselves.
    """
    table = recipe.features or FeaturesTable()
    channels = ([str(label) for label in run["polarization"].values], list(recipe.image.subbands), cleaned.grid)
    main = FeatureSettings(recipe.contrast.patch(), table.inner, recipe.run_view.y_max, table.psi)
    sums = {"": FeatureSums(alarms, *channels, main)}
    if table.variants:
        linear = FeatureSettings(main.patch, main.inner, main.y_max, "linear")
        sums |= {SWAPPED: FeatureSums(alarms, *channels, main.swapped()), PAPER: FeatureSums(alarms, *channels, linear)}
    return sums


def features_part(
    cleaned: CleanedRun,
    run: xr.Dataset,
    recipe: Recipe,
    alarms: pd.DataFrame,
    block: range,
    places: Places = plainly,
) -> Arrays:
    """Fourth pass over a block: what it adds to the features of the alarms that it sees.

    Parameters
    ----------
    cleaned, run, recipe, alarms
        As for :func:`feature_sums`.
    block : range
        Places of its scans among the complete ones.
    places : Places
        Goes through the block.

    Returns
    -------
    dict of ndarray
        The sums of :meth:`flgpr.features.FeatureSums.sums`, rows counted among all alarms; names as :func:`named` makes
        them of the prefixes.
    """
    poses = run["pose"].values[cleaned.imager.scans[block.start : block.stop]]
    x_min, x_max, _, y_max = cleaned.grid.extent()
    farthest = np.hypot(max(abs(x_min), abs(x_max)), y_max)
    y = alarms["y"].to_numpy(dtype=np.float64)
    near = np.flatnonzero((y >= poses[:, 1].min() - farthest) & (y <= poses[:, 1].max() + farthest))
    sums = feature_sums(cleaned, run, recipe, alarms.iloc[near])

    def gathered() -> Arrays:
        return {key: value for name, one in sums.items() for key, value in named(name, one.sums()).items()}

    def take(kept: Arrays) -> None:
        for name, one in sums.items():
            one.take(under(kept, name))

    for image, gain, pose in cleaned.scans(places(block, take, gathered)):
        magnitude = cleaned.background.magnitude(image, gain)
        coherent = cleaned.background.coherent(image, gain)
        for name, one in sums.items():
            own = cleaned.background.own_coherent(image, gain) if name == PAPER else coherent
            one.add(magnitude, own, pose)
    return {key: near[value] if key.endswith("|row") else value for key, value in gathered().items()}


def named(name: str, part: Mapping[str, NDArray[Any]]) -> Arrays:
    """Put a name before those of arrays.

    Parameters
    ----------
    name : str
        The name; may be empty.
    part : mapping of str to ndarray
        The arrays.

    Returns
    -------
    dict of ndarray
        They, called NAME|OLD.
    """
    return {f"{name}|{key}": value for key, value in part.items()}


def under(part: Mapping[str, NDArray[Any]], name: str) -> Arrays:
    """Find the arrays under a name.

    Parameters
    ----------
    part : mapping of str to ndarray
        Arrays of :func:`named`, among others.
    name : str
        The name.

    Returns
    -------
    dict of ndarray
        Those of that name, called as they were before.
    """
    return {key.rpartition("|")[2]: part[key] for key in part if key.rpartition("|")[:2] == (name, "|")}


def features_of(
    cleaned: CleanedRun, run: xr.Dataset, recipe: Recipe, alarms: pd.DataFrame, parts: Iterable[dict[str, Arrays]]
) -> pd.DataFrame:
    """Fold the fourth pass.

    Parameters
    ----------
    cleaned, run, recipe, alarms
        As for :func:`feature_sums`.
    parts : iterable
        All blocks' parts in order.

    Returns
    -------
    DataFrame
        ``scans`` and the features of every sub-band, see :class:`flgpr.features.FeatureSums`; those of the variants
        under the prefixes ``SWAPPED`` (all) and ``PAPER`` (the polarimetric ones).
    """
    sums = feature_sums(cleaned, run, recipe, alarms)
    for part in parts:
        for name, one in sums.items():
            one.take(part[name])
    tables = []
    for name, one in sums.items():
        columns = one.table()
        if name == PAPER:
            columns = columns[[f"{p}_{band}" for band in recipe.image.subbands for p in POLARIMETRIC]]
        tables.append(columns.drop(columns="scans").add_prefix(name) if name == SWAPPED else columns.add_prefix(name))
    return pd.concat(tables, axis=1)
