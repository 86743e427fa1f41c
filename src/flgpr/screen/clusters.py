"""flsar2004's prescreeners: amplitude with clustering, standard deviation, energy within an ellipse (Sec. 3.1)."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import cKDTree

FloatArray = NDArray[np.float64]
Rule = Literal["and", "or", "and-or"]
RULES = ("and", "or", "and-or")
CLUSTER_COLUMNS = ("x", "y", "peak", "size", "mean", "std", "energy_ratio")


@dataclass(frozen=True)
class Ellipse:
    """Template of the energy ratio (Fig. 2): an ellipse, and a rectangle twice as long and wide around it."""

    #: half_x, half_y: half-axes cross-track and down-track, m
    half_x: float
    half_y: float
    #: offset_x, offset_y: from a signature's brightest pixel, where it is applied, to the ellipse's centre, m
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
    """Mark the pixels of a magnitude (y, x) above a threshold and gather them into clusters (Sec. 3.1.1).

    The paper names a clustering method without its parameters; here a marked pixel that none within
    ``radius`` (m; the paper's is 20 cm) outshines leads a cluster, and every other joins the
    strongest leader within the radius, if there is one: a cluster depends on its surroundings
    alone, however long the lane.

    The table has x, y (m) of the strongest pixel, peak, size (marked area, m²), mean, std of the marked amplitudes;
    from strong to weak.
    """
    if image.dims != ("y", "x"):
        raise ValueError(f"image must have the dimensions (y, x), got {image.dims}")
    if not radius > 0:
        raise ValueError(f"radius must be positive, got {radius}")
    values = np.asarray(image.values, dtype=np.float64)
    x, y = image["x"].values, image["y"].values
    rows, columns = np.nonzero(values > threshold)
    order = np.argsort(-values[rows, columns], kind="stable")
    rows, columns = rows[order], columns[order]
    amplitude = values[rows, columns]
    place = np.column_stack([x[columns], y[rows]])
    pixel = _pixel(image)
    found = []
    for members in _leaders(place, radius):
        inside = amplitude[members]
        found.append(
            (*place[members[0]], inside[0], members.size * pixel, inside.mean(), inside.std())
        )
    return pd.DataFrame(found, columns=list(CLUSTER_COLUMNS[:-1]), dtype=np.float64)


def _leaders(points: FloatArray, radius: float) -> list[NDArray[np.intp]]:
    """Group points (n, 2), the strongest first, about leaders; the leader is the first of its group."""
    if not len(points):
        return []
    strong, weak = (
        cKDTree(points).query_pairs(radius * (1 + 1e-9), output_type="ndarray").T
    )  # strong < weak
    joins = np.arange(len(points))
    joins[weak] = len(points)
    leads = joins < len(points)
    led = leads[strong]
    np.minimum.at(joins, weak[led], strong[led])
    order = np.argsort(joins, kind="stable")
    ends = np.searchsorted(joins[order], np.flatnonzero(leads), "right")
    return np.split(order, ends)[:-1]


def energy_ratio(image: xr.DataArray, places: ArrayLike, ellipse: Ellipse) -> FloatArray:
    """Energy outside the elliptical template over that inside (Sec. 3.1.3), for clusters of a magnitude.

    ``places`` (n, 2), m, are the clusters' brightest pixels; the ellipse lies at its offset from them. What reaches
    beyond the image is left out; inf where no energy is inside.
    """
    power = np.nan_to_num(np.asarray(image.values, dtype=np.float64)) ** 2
    x, y = image["x"].values, image["y"].values
    ratio = np.empty(len(np.reshape(places, (-1, 2))))
    centres = np.reshape(np.asarray(places, dtype=np.float64), (-1, 2)) + [
        ellipse.offset_x,
        ellipse.offset_y,
    ]
    for i, (u, v) in enumerate(centres):
        rows = np.flatnonzero(np.abs(y - v) <= 2 * ellipse.half_y)
        columns = np.flatnonzero(np.abs(x - u) <= 2 * ellipse.half_x)
        inside = ((x[columns] - u) / ellipse.half_x) ** 2 + (
            (y[rows, None] - v) / ellipse.half_y
        ) ** 2 <= 1
        part = power[np.ix_(rows, columns)]
        e_in = float(part[inside].sum())
        ratio[i] = (float(part.sum()) - e_in) / e_in if e_in > 0 else math.inf
    return ratio


def prescreen_clusters(
    image: xr.DataArray, thresholds: ClusterThresholds, ellipse: Ellipse, radius: float = 0.2
) -> pd.DataFrame:
    """Apply the three prescreeners in sequence to a magnitude (y, x) (Sec. 3.1): ``CLUSTER_COLUMNS`` of what passes.

    The radius is that of :func:`find_clusters`.
    """
    table = find_clusters(image, thresholds.amplitude, radius)
    table = table[(table["size"] >= thresholds.size) & (table["std"] <= thresholds.std)]
    ratio = energy_ratio(image, table[["x", "y"]].to_numpy(), ellipse)
    table = table.assign(energy_ratio=ratio)
    return table[table["energy_ratio"] <= thresholds.energy_ratio].reset_index(drop=True)


def learn_thresholds(
    lanes: Sequence[tuple[xr.DataArray, ArrayLike]], ellipse: Ellipse, radius: float = 0.2, reach: float = 0.5,
    pass_share: float = 0.9,
) -> ClusterThresholds:  # fmt: skip
    """Set the thresholds so that a share of given mines passes each prescreener on its own.

    Each lane is a magnitude (y, x) and the places (n, 2) of its mines, m. A mine's peak is the largest pixel within
    ``reach`` of its place. The amplitude threshold is half the peak that the share of the mines exceeds, so that a
    cluster is what lies within 6 dB of a weak mine's peak. The other limits are quantiles over the mines' clusters,
    which are those that :func:`find_clusters` finds, as when the thresholds are applied. The mines should be a subset
    that is not used again; the images must see one.
    """
    if not 0 < pass_share <= 1:
        raise ValueError(f"pass_share must lie between 0 and 1, got {pass_share}")
    peaks = np.concatenate([_peaks(image, places, reach) for image, places in lanes])
    if not peaks.size:
        raise ValueError("places must hold at least one mine that the image sees, got none")
    amplitude = 0.5 * float(np.quantile(peaks, 1 - pass_share))
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
        float(np.quantile(clusters["size"], 1 - pass_share)),
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
    """Give the strongest cluster within ``reach`` of every place, with its energy ratio.

    Where the brightest pixel within reach is outshone by a neighbour beyond, the cluster is that neighbour's. A place
    without a cluster (fainter than the threshold, or not seen) gives none.
    """
    clusters = find_clusters(image.fillna(0.0), amplitude, radius)
    centres = clusters[["x", "y"]].to_numpy(dtype=np.float64)
    rows = []
    for place in np.reshape(np.asarray(places, dtype=np.float64), (-1, 2)):
        distance = np.linalg.norm(centres - place, axis=1)
        near = np.flatnonzero(distance <= reach)
        if not near.size:
            near = np.flatnonzero(distance <= reach + radius)
        if near.size:
            rows.append(near[0])  # from strong to weak
    table = clusters.iloc[rows]
    return table.assign(energy_ratio=energy_ratio(image, table[["x", "y"]].to_numpy(), ellipse))


def _pixel(image: xr.DataArray) -> float:
    """Area of a pixel, m², the same wherever along the lane the image begins: areas are compared with limits."""
    dy, dx = (float(image[axis].values[1] - image[axis].values[0]) for axis in ("y", "x"))
    return round(dx * dy, 9)


def _peaks(image: xr.DataArray, places: ArrayLike, reach: float) -> FloatArray:
    """Give the largest magnitude within reach of every place that some scan saw."""
    values = np.nan_to_num(np.asarray(image.values, dtype=np.float64))
    x, y = np.meshgrid(image["x"].values, image["y"].values)
    peaks = []
    for u, v in np.reshape(np.asarray(places, dtype=np.float64), (-1, 2)):
        near = values[(x - u) ** 2 + (y - v) ** 2 <= reach**2]
        if near.size and near.max() > 0:
            peaks.append(near.max())
    return np.array(peaks)


def fit_ellipse(template: ArrayLike, spacing: tuple[float, float]) -> Ellipse:
    """Match the ellipse to a mean signature (y, x) whose pixels are ``spacing`` (x, y) apart, m.

    Its half-axes are twice the rms width of the signature's energy above its median: an even ellipse has the same
    second moments. Its centre is the centroid of that energy, told as the offset from the brightest pixel, about which
    a cluster is looked at: a signature with two flashes has its brightest pixel in one of them.
    """
    power = np.asarray(template, dtype=np.float64) ** 2
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
        place = np.arange(profile.size) * step
        centre = (place * profile).sum() / profile.sum()
        variance = ((place - centre) ** 2 * profile).sum() / profile.sum()
        half.append(2 * math.sqrt(max(variance, (step / 2) ** 2)))
        offset.append(float(centre - brightest[axis] * step))
    return Ellipse(half[0], half[1], offset[0], offset[1])


def fuse_clusters(
    tables: Mapping[tuple[str, Any], pd.DataFrame],
    radius: float = 0.4,
    rule: Rule = "and",
    levels: Mapping[tuple[str, Any], float] | None = None,
) -> pd.DataFrame:
    """Bring together the clusters of all polarizations and ranges into regions (par. 18 and 44).

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
        What the peaks of an image are measured in; default the mean peak of its clusters.

    Returns
    -------
    DataFrame
        x, y (m), mean over the images' strongest clusters; ``images``, how many saw it;
        ``strength``, its peak over the image's level.
    """
    if rule not in RULES:
        raise ValueError(f"rule must be one of {', '.join(RULES)}, got {rule!r}")
    if not tables:
        raise ValueError("tables must hold at least one image, got none")
    keys = list(tables)
    parts = [
        table[["x", "y"]].assign(
            strength=table["peak"] / (levels[key] if levels else table["peak"].mean()), image=i
        )
        for i, (key, table) in enumerate(tables.items())
    ]
    pool = pd.concat(parts, ignore_index=True).sort_values(
        "strength", ascending=False, kind="stable"
    )
    pool = pool.reset_index(drop=True)
    regions = []
    for members in _leaders(pool[["x", "y"]].to_numpy(dtype=np.float64), radius):
        best = pool.iloc[members].drop_duplicates("image")
        if _passes({keys[i] for i in best["image"]}, keys, rule):
            regions.append(
                (best["x"].mean(), best["y"].mean(), len(best), best["strength"].iloc[0])
            )
    table = pd.DataFrame(regions, columns=["x", "y", "images", "strength"])
    return table.astype({"x": float, "y": float, "images": int, "strength": float})


def _passes(seen: set[tuple[str, Any]], keys: list[tuple[str, Any]], rule: Rule) -> bool:
    if rule == "and":
        return len(seen) == len(keys)
    if rule == "or":
        return bool(seen)
    return any(
        all(key in seen for key in keys if key[0] == name) for name in {name for name, _ in keys}
    )
