"""What a focused image shows: limits, pixels and scans that are chosen where nothing is said."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from flgpr.imaging.ground import seen_ground
from flgpr.model import SPEED_OF_LIGHT, complete_scans

Extent = tuple[float, float] | float
MOST_PIXELS = 50_000_000
_ONE_TONE = 20e-9  # s, to which a section of a single tone goes down; assumed


@dataclass(frozen=True)
class View:
    """What to image.

    Each of ``x``, ``y``, ``z`` (lane frame, m) is a pair of limits or one value; two pairs are a
    plane, three a volume. What is not told follows from the run: the ground ahead of antennas that
    stand above it, else the section below the line, down to the end of the record; ``z`` alone
    bounds that section or sets the height of that ground. ``scans`` are the first and the last that
    are summed, default all; ``spacing`` (m) is by default a quarter of the wavelength, or what
    gives 300 000 pixels. ``permittivity`` is that of all between antennas and pixels, 1 by default;
    for antennas that are coupled to the ground it must be told. ``half_space`` is that of ground
    below z = 0, at whose surface paths are refracted. Antennas farther than ``reach`` (m) from a
    pixel, level with the ground, do not help to image it.
    """

    x: Extent | None = None
    y: Extent | None = None
    z: Extent | None = None
    spacing: float | None = None
    scans: tuple[int, int] | None = None
    polarizations: tuple[str, ...] = ()
    band: tuple[float, float] | None = None  #: Hz
    window: str = "hann"
    permittivity: float | None = None
    half_space: float | None = None
    reach: float = math.inf


def chosen_scans(run: xr.Dataset, limits: tuple[int, int] | None) -> NDArray[np.intp]:
    """Return the complete scans within limits, both counted."""
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
    run: xr.Dataset, view: View, pose: NDArray[np.float64], pixels: int
) -> tuple[dict[str, NDArray[np.float64]], float]:
    """Return the pixels' axes and their spacing, m; about so many pixels where no spacing is given."""
    frequency = run["frequency"].values
    slow = math.sqrt(view.half_space or view.permittivity or 1.0)
    limits: dict[str, Extent | None] = {"x": view.x, "y": view.y, "z": view.z}
    height = (
        pose[:, 2].mean()
        + (run["tx_position"].values[:, 2].mean() + run["rx_position"].values[:, 2].mean()) / 2
    )
    if view.x is None and view.y is None:
        above = height > 0 and run.attrs.get("sounding") != "ground-coupled"
        usual = _ground_ahead(run, pose) if above else _section_below(run, pose, slow)
        limits = usual if view.z is None else usual | {"z": view.z}
    elif view.z is None:
        limits["z"] = 0.0
    told = {axis: value for axis, value in limits.items() if value is not None}
    missing = [axis for axis in "xyz" if axis not in told]
    if missing:
        raise ValueError(
            f"{' and '.join(missing)} must be told beside the others, a value or two limits, got none"
        )
    wide = {axis: value for axis, value in told.items() if isinstance(value, tuple)}
    if len(wide) < 2:
        raise ValueError(
            f"two of x, y and z must have two limits to make a picture, got {', '.join(wide) or 'none'}"
        )
    for axis, (low, high) in wide.items():
        if not (math.isfinite(low) and math.isfinite(high) and high > low):
            raise ValueError(f"{axis} must have limits that increase, got {low:g}, {high:g}")
    spacing = view.spacing
    if spacing is None:
        band = view.band or (frequency[0], frequency[-1])
        size = math.prod(high - low for low, high in wide.values())
        spacing = max(
            SPEED_OF_LIGHT / slow / (2 * (band[0] + band[1])), (size / pixels) ** (1 / len(wide))
        )
        spacing = float(f"{spacing:.2g}")
    if not (math.isfinite(spacing) and spacing > 0):
        raise ValueError(f"spacing must be positive, got {spacing:g} m")
    counts = {axis: round((high - low) / spacing) + 1 for axis, (low, high) in wide.items()}
    if math.prod(counts.values()) > MOST_PIXELS or min(counts.values()) < 2:
        told_of = " x ".join(f"{axis} {count}" for axis, count in counts.items())
        raise ValueError(
            f"spacing must give 2 pixels or more along an axis and {MOST_PIXELS:g} in all, got {told_of}"
        )
    axes = {
        axis: np.round(told[axis][0] + spacing * np.arange(counts[axis]), 9)  # type: ignore[index]
        if axis in counts
        else np.array([float(told[axis])])  # type: ignore[arg-type]
        for axis in "xyz"
    }
    return axes, spacing


def _ground_ahead(run: xr.Dataset, pose: NDArray[np.float64]) -> dict[str, Extent | None]:
    """Return the limits of the ground that antennas above it see, m."""
    lane = seen_ground(run, pose)
    return {"x": (lane.x_min, lane.x_max), "y": (lane.y_min, lane.y_max), "z": 0.0}


def _section_below(
    run: xr.Dataset, pose: NDArray[np.float64], slow: float
) -> dict[str, Extent | None]:
    """Return the limits of the section below a line, m, down to the end of the record."""
    along = "x" if np.ptp(pose[:, 0]) > np.ptp(pose[:, 1]) else "y"
    ends = {axis: pose[:, "xy".index(axis)] for axis in "xy"}
    limits: dict[str, Extent | None] = {axis: float(ends[axis].mean()) for axis in "xy"}
    limits[along] = float(ends[along].min()), float(ends[along].max())
    top = max(float(pose[:, 2].max()), 0.0)
    limits["z"] = (min(float(pose[:, 2].min()), 0.0) - _recorded_depth(run, slow), top)
    return limits


def _recorded_depth(run: xr.Dataset, slow: float) -> float:
    """Return how deep a wave goes by the end of the record, m, or by the tones' repetition where there is no record."""
    frequency = run["frequency"].values
    window = run.attrs.get("time_window_s")
    first = run.attrs.get("first_sample_s")
    if window is not None and first is not None and window + first > 0:
        last = float(window) + float(first)
    else:
        last = 1 / float(np.diff(frequency).mean()) if frequency.size > 1 else _ONE_TONE
    return SPEED_OF_LIGHT / slow * last / 2
