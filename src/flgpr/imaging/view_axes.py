"""What a focused image shows: limits, pixels and scans that are chosen where nothing is said."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import xarray as xr

from flgpr.imaging.ground import seen_ground
from flgpr.model import SPEED_OF_LIGHT, complete_scans
from flgpr.types import FloatArray, IndexArray

Extent = tuple[float, float] | float
MOST_PIXELS = 50_000_000
_ONE_TONE = 20e-9  # s, to which a section of a single tone goes down; assumed


@dataclass(frozen=True)
class View:
    """What to image.

    Each of ``x``, ``y``, ``z`` (lane frame, m) is a pair of limits or one value; two pairs are a
    plane, three a volume. Without them the pixels follow from the run: the ground ahead of antennas
    that stand above it, else the section below the line, down to the end of the record; ``z`` alone
    bounds that section or sets the height of that ground.
    """

    x: Extent | None = None
    y: Extent | None = None
    z: Extent | None = None
    #: of the pixels, m; by default a quarter of the wavelength, or what gives 300 000 pixels
    spacing: float | None = None
    scans: tuple[int, int] | None = None  #: first and last that are summed; by default all
    polarizations: tuple[str, ...] = ()
    band: tuple[float, float] | None = None  #: Hz
    window: str = "hann"
    #: of all between antennas and pixels, 1 by default; antennas that are coupled to the ground
    #: need it
    permittivity: float | None = None
    half_space: float | None = None  #: permittivity below z = 0, where paths are refracted
    #: how far from a pixel, level with the ground, antennas help to image it, m
    reach: float = math.inf


def chosen_scans(run: xr.Dataset, limits: tuple[int, int] | None) -> IndexArray:
    """Return the complete scans within limits, both included.

    Parameters
    ----------
    run : xarray.Dataset
        The run.
    limits : tuple of int, optional
        First and last scan; None is all.

    Returns
    -------
    (scan,) ndarray of int
        Numbers of the scans.

    Raises
    ------
    ValueError
        If the limits are none of the run's scans, or no scan within them is complete.
    """
    count = run.sizes["scan"]
    first, last = limits or (0, count - 1)
    if not 0 <= first <= last < count:
        raise ValueError(
            f"scans must have 0 <= first <= last < {count}, the run's, got {first}, {last}"
        )
    scans = np.flatnonzero(complete_scans(run))
    chosen = scans[(scans >= first) & (scans <= last)]
    if not chosen.size:
        raise ValueError(
            f"scans must hold one without missing sweeps, got none from {first} to {last}"
        )
    return chosen


def view_axes(
    run: xr.Dataset, view: View, pose: FloatArray, pixels: int
) -> tuple[dict[str, FloatArray], float]:
    """Return the pixels' axes and their spacing.

    Parameters
    ----------
    run : xarray.Dataset
        The run.
    view : View
        What to image.
    pose : ndarray (scan, 6)
        Poses of the scans that are summed, m and rad.
    pixels : int
        About how many pixels there are where no spacing is given.

    Returns
    -------
    axes : dict of ndarray
        Pixel centres along x, y and z, m.
    spacing : float
        Spacing of the pixels, m.

    Raises
    ------
    ValueError
        If limits are missing or do not increase, or the spacing gives too few or too many pixels.
    """
    slowness = math.sqrt(view.half_space or view.permittivity or 1.0)
    limits = _view_limits(run, view, pose, slowness)
    spans = {axis: value for axis, value in limits.items() if isinstance(value, tuple)}
    _check_spans(spans)
    spacing = view.spacing
    if spacing is None:
        spacing = _default_spacing(run, view, spans, pixels, slowness)
    counts = _pixel_counts(spans, spacing)
    axes = {}
    for axis in "xyz":
        limit = limits[axis]
        if isinstance(limit, tuple):
            axes[axis] = np.round(limit[0] + spacing * np.arange(counts[axis]), 9)
        else:
            axes[axis] = np.array([float(limit)])
    return axes, spacing


def _pixel_counts(spans: dict[str, tuple[float, float]], spacing: float) -> dict[str, int]:
    """Return the numbers of pixels along the axes, and refuse too few or too many."""
    if not (math.isfinite(spacing) and spacing > 0):
        raise ValueError(f"spacing must be positive, got {spacing:g} m")
    counts = {axis: round((high - low) / spacing) + 1 for axis, (low, high) in spans.items()}
    if math.prod(counts.values()) > MOST_PIXELS or min(counts.values()) < 2:
        listed = " x ".join(f"{axis} {count}" for axis, count in counts.items())
        raise ValueError(
            f"spacing must give 2 pixels or more along an axis and {MOST_PIXELS:g} in all, "
            f"got {listed}"
        )
    return counts


def _view_limits(
    run: xr.Dataset, view: View, pose: FloatArray, slowness: float
) -> dict[str, Extent]:
    """Return the limits along every axis, m, those that follow from the run among them."""
    limits: dict[str, Extent | None] = {"x": view.x, "y": view.y, "z": view.z}
    antenna_height = (
        run["tx_position"].values[:, 2].mean() + run["rx_position"].values[:, 2].mean()
    ) / 2
    height = pose[:, 2].mean() + antenna_height
    if view.x is None and view.y is None:
        above = height > 0 and run.attrs.get("sounding") != "ground-coupled"
        if above:
            lane = seen_ground(run, pose)
            limits = {"x": (lane.x_min, lane.x_max), "y": (lane.y_min, lane.y_max), "z": 0.0}
        else:
            limits = _section_below(run, pose, slowness)
        if view.z is not None:
            limits["z"] = view.z
    elif view.z is None:
        limits["z"] = 0.0
    complete = {axis: value for axis, value in limits.items() if value is not None}
    missing = [axis for axis in "xyz" if axis not in complete]
    if missing:
        raise ValueError(
            f"{' and '.join(missing)} must be given beside the others, a value or two limits, "
            "got none"
        )
    return complete


def _check_spans(spans: dict[str, tuple[float, float]]) -> None:
    """Raise a ValueError for fewer than two axes with limits, or limits that do not increase."""
    if len(spans) < 2:
        raise ValueError(
            "two of x, y and z must have two limits to make a picture, "
            f"got {', '.join(spans) or 'none'}"
        )
    for axis, (low, high) in spans.items():
        if not (math.isfinite(low) and math.isfinite(high) and high > low):
            raise ValueError(f"{axis} must have limits that increase, got {low:g}, {high:g}")


def _default_spacing(
    run: xr.Dataset,
    view: View,
    spans: dict[str, tuple[float, float]],
    pixels: int,
    slowness: float,
) -> float:
    """Return a quarter of the mean wavelength, or what gives ``pixels``, m, to two digits."""
    frequency = run["frequency"].values
    lowest, highest = view.band or (frequency[0], frequency[-1])
    size = math.prod(high - low for low, high in spans.values())
    quarter_wave = SPEED_OF_LIGHT / slowness / (2 * (lowest + highest))
    spacing = max(quarter_wave, (size / pixels) ** (1 / len(spans)))
    return float(f"{spacing:.2g}")


def _section_below(run: xr.Dataset, pose: FloatArray, slowness: float) -> dict[str, Extent | None]:
    """Return the limits of the section below a line, m, down to the end of the record."""
    along = "x" if np.ptp(pose[:, 0]) > np.ptp(pose[:, 1]) else "y"
    ends = {axis: pose[:, "xy".index(axis)] for axis in "xy"}
    limits: dict[str, Extent | None] = {axis: float(ends[axis].mean()) for axis in "xy"}
    limits[along] = float(ends[along].min()), float(ends[along].max())
    top = max(float(pose[:, 2].max()), 0.0)
    limits["z"] = (min(float(pose[:, 2].min()), 0.0) - _recorded_depth(run, slowness), top)
    return limits


def _recorded_depth(run: xr.Dataset, slowness: float) -> float:
    """Return how deep a wave goes by the end of the record, m.

    Where there is no record it is the repetition of the tones' echoes that counts.
    """
    frequency = run["frequency"].values
    window = run.attrs.get("time_window_s")
    first = run.attrs.get("first_sample_s")
    if window is not None and first is not None and window + first > 0:
        last = float(window) + float(first)
    elif frequency.size > 1:
        last = 1 / float(np.diff(frequency).mean())
    else:
        last = _ONE_TONE
    return SPEED_OF_LIGHT / slowness * last / 2
