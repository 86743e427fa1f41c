"""Prescreeners of flsar2004: amplitude with clustering, standard deviation, energy in an ellipse.

They are described in Sec. 3.1.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import pandas as pd
import xarray as xr
from scipy.spatial import cKDTree

from flgpr.screen.views import grid_of
from flgpr.types import ArrayLike, FloatArray, IndexArray, floats

Rule = Literal["and", "or", "and-or"]
RULES = ("and", "or", "and-or")
CLUSTER_COLUMNS = ("x", "y", "peak", "size", "mean", "std", "energy_ratio")


@dataclass(frozen=True)
class Ellipse:
    """Template of the energy ratio (Fig. 2): an ellipse in a rectangle twice as long and wide."""

    half_x: float  #: half-axis cross-track, m
    half_y: float  #: half-axis down-track, m
    #: from the brightest pixel of a signature, where it is applied, to the ellipse's centre, m
    offset_x: float = 0.0
    offset_y: float = 0.0

    def __post_init__(self) -> None:
        if not (self.half_x > 0 and self.half_y > 0):
            raise ValueError(
                f"ellipse half-axes must be positive, got {self.half_x} and {self.half_y}"
            )


@dataclass(frozen=True)
class ClusterThresholds:
    """Thresholds of the three prescreeners for one polarization and range."""

    amplitude: float  #: pixels above it are marked, in units of the image
    size: float  #: least marked area of a cluster, m²
    std: float  #: largest standard deviation of the amplitude in a cluster, in units of the image
    energy_ratio: float  #: largest E_out/E_in


def find_clusters(image: xr.DataArray, threshold: float, radius: float = 0.2) -> pd.DataFrame:
    """Return clusters of the pixels above a threshold (flsar2004, Sec. 3.1.1).

    The paper names a clustering method without its parameters. Here a marked pixel that none within
    the radius outshines leads a cluster, and every other joins the strongest leader within the
    radius, if there is one: a cluster depends on its surroundings alone, however long the lane.

    Parameters
    ----------
    image : (y, x) xarray.DataArray
        Magnitude.
    threshold : float
        Pixels above it are marked, in units of the image.
    radius : float
        Radius of a cluster, m; the paper's is 20 cm.

    Returns
    -------
    DataFrame
        From strong to weak: x, y (m) of the strongest pixel, peak, size (marked area, m²), mean and
        std of the marked amplitudes.

    Raises
    ------
    ValueError
        If the image has other dimensions or the radius is not positive.
    """
    if image.dims != ("y", "x"):
        raise ValueError(f"image must have the dimensions (y, x), got {image.dims}")
    if not radius > 0:
        raise ValueError(f"radius must be positive, got {radius}")
    values = floats(image.values)
    grid = grid_of(image)
    x = image["x"].values
    y = image["y"].values
    rows, columns = np.nonzero(values > threshold)
    order = np.argsort(-values[rows, columns], kind="stable")
    rows = rows[order]
    columns = columns[order]
    amplitude = values[rows, columns]
    position = np.column_stack([x[columns], y[rows]])
    # Rounded, so that it is the same wherever along the lane the image begins: areas are compared
    # with limits.
    pixel_area = round(grid.dx * grid.dy, 9)
    clusters = []
    for members in _groups_about_leaders(position, radius):
        marked = amplitude[members]
        size = members.size * pixel_area
        leader_x, leader_y = position[members[0]]
        clusters.append((leader_x, leader_y, marked[0], size, marked.mean(), marked.std()))
    return pd.DataFrame(clusters, columns=list(CLUSTER_COLUMNS[:-1]), dtype=np.float64)


def _groups_about_leaders(points: FloatArray, radius: float) -> list[IndexArray]:
    """Group points (n, 2), the strongest first, about leaders, each the first of its group."""
    if not len(points):
        return []
    # The first of a pair has the smaller number: it is the stronger one.
    pairs = cKDTree(points).query_pairs(radius * (1 + 1e-9), output_type="ndarray")
    strong, weak = pairs.T
    no_leader = len(points)
    leader = np.arange(len(points))
    leader[weak] = no_leader
    leads = leader < no_leader

    # The strongest leader within the radius has the smallest number. A point that only points
    # which do not lead outshine belongs to no group: it is the last group, which is left out.
    by_leader = leads[strong]
    np.minimum.at(leader, weak[by_leader], strong[by_leader])
    order = np.argsort(leader, kind="stable")
    ends = np.searchsorted(leader[order], np.flatnonzero(leads), "right")
    return np.split(order, ends)[:-1]


def energy_ratio(image: xr.DataArray, places: ArrayLike, ellipse: Ellipse) -> FloatArray:
    """Compute the energy outside the elliptical template over that inside (flsar2004, Sec. 3.1.3).

    Parameters
    ----------
    image : (y, x) xarray.DataArray
        Magnitude; NaN counts as zero.
    places : (n, 2) array_like
        x, y of the clusters' brightest pixels, m; the ellipse lies at its offset from them.
    ellipse : Ellipse
        Template; what of it reaches beyond the image is left out.

    Returns
    -------
    (n,) ndarray
        Ratio, 1; inf where no energy is inside.
    """
    power = np.nan_to_num(floats(image.values)) ** 2
    x = image["x"].values
    y = image["y"].values
    positions = np.reshape(floats(places), (-1, 2))
    centres = positions + [ellipse.offset_x, ellipse.offset_y]
    ratio = np.empty(len(positions))
    for i, (u, v) in enumerate(centres):
        # The rectangle of Fig. 2 is twice as long and wide as the ellipse.
        rows = np.flatnonzero(np.abs(y - v) <= 2 * ellipse.half_y)
        columns = np.flatnonzero(np.abs(x - u) <= 2 * ellipse.half_x)
        across = (x[columns] - u) / ellipse.half_x
        along = (y[rows, None] - v) / ellipse.half_y
        rectangle = power[np.ix_(rows, columns)]
        e_in = float(rectangle[across**2 + along**2 <= 1].sum())
        e_out = float(rectangle.sum()) - e_in
        ratio[i] = e_out / e_in if e_in > 0 else math.inf
    return ratio


def prescreen_clusters(
    image: xr.DataArray, thresholds: ClusterThresholds, ellipse: Ellipse, radius: float = 0.2
) -> pd.DataFrame:
    """Apply the three prescreeners in sequence (flsar2004, Sec. 3.1).

    Parameters
    ----------
    image : (y, x) xarray.DataArray
        Magnitude.
    thresholds : ClusterThresholds
        Of the polarization and range of the image.
    ellipse : Ellipse
        Template of the energy ratio.
    radius : float
        As for :func:`find_clusters`, m.

    Returns
    -------
    DataFrame
        ``CLUSTER_COLUMNS`` of the clusters that pass, from strong to weak.
    """
    table = find_clusters(image, thresholds.amplitude, radius)
    table = table[(table["size"] >= thresholds.size) & (table["std"] <= thresholds.std)]
    ratio = energy_ratio(image, table[["x", "y"]].to_numpy(), ellipse)
    table = table.assign(energy_ratio=ratio)
    return table[table["energy_ratio"] <= thresholds.energy_ratio].reset_index(drop=True)


def learn_thresholds(
    lanes: Sequence[tuple[xr.DataArray, ArrayLike]],
    ellipse: Ellipse,
    radius: float = 0.2,
    reach: float = 0.5,
    pass_share: float = 0.9,
    size: float | None = None,
) -> ClusterThresholds:
    """Estimate thresholds with which a share of known mines passes each prescreener.

    The amplitude threshold is half the peak that the share of the mines exceeds, so that a cluster
    is what lies within 6 dB of a weak mine's peak; of a given size it is the largest with which the
    clusters of the share are so large. The other limits are quantiles over the mines'
    clusters, which are those of :func:`find_clusters`, as when the thresholds are applied.

    Parameters
    ----------
    lanes : sequence of (DataArray, array_like)
        A magnitude (y, x) and the positions (n, 2) of mines, m, that are not used again.
    ellipse : Ellipse
        Template of the energy ratio.
    radius : float
        As for :func:`find_clusters`, m.
    reach : float
        A mine's peak is the largest pixel within this distance, m.
    pass_share : float
        Share of the mines that passes each prescreener on its own, above 0 and up to 1.
    size : float, optional
        Least marked area of a cluster, m², where it is given and not learnt.

    Returns
    -------
    ClusterThresholds
        The thresholds.

    Raises
    ------
    ValueError
        If the share is out of range, or no mine is seen or leads a cluster.
    """
    if not 0 < pass_share <= 1:
        raise ValueError(f"pass_share must lie between 0 and 1, got {pass_share}")
    peaks = np.concatenate([_peaks(image, places, reach, size, radius) for image, places in lanes])
    if not peaks.size:
        raise ValueError("places must hold at least one mine that the image sees, got none")
    amplitude = (0.5 if size is None else 1.0) * float(np.quantile(peaks, 1 - pass_share))
    clusters = pd.concat(
        [
            _clusters_of_mines(image, places, amplitude, radius, reach, ellipse)
            for image, places in lanes
        ]
    )
    if clusters.empty:
        raise ValueError(
            "places must hold at least one mine that leads a cluster of its own, got none"
        )
    return ClusterThresholds(
        amplitude,
        float(np.quantile(clusters["size"], 1 - pass_share)) if size is None else size,
        float(np.quantile(clusters["std"], pass_share)),
        float(np.quantile(clusters["energy_ratio"], pass_share)),
    )


def _clusters_of_mines(
    image: xr.DataArray,
    places: ArrayLike,
    amplitude: float,
    radius: float,
    reach: float,
    ellipse: Ellipse,
) -> pd.DataFrame:
    """Return the strongest cluster within ``reach`` of every position, with its energy ratio.

    Where the brightest pixel within reach is outshone by a neighbour beyond, the cluster is that
    neighbour's. A position without a cluster, fainter than the threshold or not seen, has no row.
    """
    clusters = find_clusters(image.fillna(0.0), amplitude, radius)
    centres = clusters[["x", "y"]].to_numpy(dtype=np.float64)
    rows = []
    for position in np.reshape(floats(places), (-1, 2)):
        distance = np.linalg.norm(centres - position, axis=1)
        within = np.flatnonzero(distance <= reach)
        if not within.size:
            within = np.flatnonzero(distance <= reach + radius)
        if within.size:
            rows.append(within[0])  # clusters are sorted from strong to weak
    table = clusters.iloc[rows]
    ratio = energy_ratio(image, table[["x", "y"]].to_numpy(), ellipse)
    return table.assign(energy_ratio=ratio)


def _peaks(
    image: xr.DataArray, places: ArrayLike, reach: float, size: float | None, radius: float
) -> FloatArray:
    """Return the largest magnitude within reach of every position that some scan saw.

    Of a given size it is the threshold under which so large an area is marked within the radius of
    that pixel.
    """
    grid = grid_of(image)
    marked = 0 if size is None else math.ceil(size / round(grid.dx * grid.dy, 9))
    values = np.nan_to_num(floats(image.values))
    x, y = np.meshgrid(image["x"].values, image["y"].values)
    peaks = []
    for u, v in np.reshape(floats(places), (-1, 2)):
        within = np.where((x - u) ** 2 + (y - v) ** 2 <= reach**2, values, 0.0)
        if within.max() <= 0:
            continue
        leader = np.unravel_index(int(within.argmax()), within.shape)
        if marked:
            near = values[(x - x[leader]) ** 2 + (y - y[leader]) ** 2 <= radius**2]
            # What is marked lies above the threshold.
            peaks.append(np.nextafter(np.sort(near)[-min(marked, near.size)], 0.0))
        else:
            peaks.append(within[leader])
    return np.array(peaks)


def fit_ellipse(template: ArrayLike, spacing: tuple[float, float]) -> Ellipse:
    """Fit the ellipse of the energy ratio to a mean signature.

    Its half-axes are twice the rms width of the signature's energy above its median: an even
    ellipse has the same second moments. Its centre is the centroid of that energy, as an offset
    from the brightest pixel, where it is applied to a cluster: a signature with two flashes has its
    brightest pixel in one of them.

    Parameters
    ----------
    template : (y, x) array_like
        Mean signature.
    spacing : tuple of float
        Pixel spacing (x, y), m.

    Returns
    -------
    Ellipse
        The template.

    Raises
    ------
    ValueError
        If the signature does not rise above its median.
    """
    power = floats(template) ** 2
    brightest = np.unravel_index(int(power.argmax()), power.shape)
    power = np.maximum(power - np.median(power), 0)
    if not power.any():
        raise ValueError(
            "template must rise above its median, as that of a mine that the images show, got zero"
        )
    half = []
    offset = []
    for axis, step in ((1, spacing[0]), (0, spacing[1])):
        profile = power.sum(axis=1 - axis)
        total = profile.sum()
        position = np.arange(profile.size) * step
        centre = (position * profile).sum() / total
        variance = ((position - centre) ** 2 * profile).sum() / total
        least_variance = (step / 2) ** 2  # that of a single pixel is zero
        half.append(2 * math.sqrt(max(variance, least_variance)))
        offset.append(float(centre - brightest[axis] * step))
    return Ellipse(half[0], half[1], offset[0], offset[1])


def fuse_clusters(
    tables: Mapping[tuple[str, Any], pd.DataFrame],
    radius: float = 0.4,
    rule: Rule = "and",
    levels: Mapping[tuple[str, Any], float] | None = None,
) -> pd.DataFrame:
    """Combine clusters of all polarizations and ranges into regions (flsar2004, par. 18 and 44).

    Parameters
    ----------
    tables : mapping of (polarization, range) to DataFrame
        Clusters that passed, with x, y, peak.
    radius : float
        Clusters within it of the strongest make one region, m.
    rule : {"and", "or", "and-or"}
        Which regions pass: those seen in all images (par. 18), in any, or in all ranges of some
        polarization (par. 44).
    levels : mapping of (polarization, range) to float, optional
        Unit of the peaks of an image; default the mean peak of its clusters.

    Returns
    -------
    DataFrame
        x, y (m), mean over the images' strongest clusters; ``images``, how many show it;
        ``strength``, its peak over the image's level.

    Raises
    ------
    ValueError
        If the rule is unknown or there is no table.
    """
    if rule not in RULES:
        raise ValueError(f"rule must be one of {', '.join(RULES)}, got {rule!r}")
    if not tables:
        raise ValueError("tables must hold at least one image, got none")
    keys = list(tables)
    # Peaks of different images are compared in units of their levels.
    scaled = []
    for i, (key, table) in enumerate(tables.items()):
        level = levels[key] if levels else table["peak"].mean()
        scaled.append(table[["x", "y"]].assign(strength=table["peak"] / level, image=i))
    clusters = pd.concat(scaled, ignore_index=True)
    clusters = clusters.sort_values("strength", ascending=False, kind="stable")
    clusters = clusters.reset_index(drop=True)
    positions = clusters[["x", "y"]].to_numpy(dtype=np.float64)
    regions = []
    for members in _groups_about_leaders(positions, radius):
        best = clusters.iloc[members].drop_duplicates("image")  # the strongest of every image
        detected_in = {keys[i] for i in best["image"]}
        if _passes(detected_in, keys, rule):
            strength = best["strength"].iloc[0]
            regions.append((best["x"].mean(), best["y"].mean(), len(best), strength))
    table = pd.DataFrame(regions, columns=["x", "y", "images", "strength"])
    return table.astype({"x": float, "y": float, "images": int, "strength": float})


def _passes(detected_in: set[tuple[str, Any]], keys: list[tuple[str, Any]], rule: Rule) -> bool:
    """Apply the rule to the images (polarization, range) that show a region, of all images."""
    if rule == "and":
        return len(detected_in) == len(keys)
    if rule == "or":
        return bool(detected_in)
    for polarization in {name for name, _ in keys}:
        of_polarization = {key for key in keys if key[0] == polarization}
        if of_polarization <= detected_in:
            return True
    return False
