"""A focused picture of a run: by one scan or over the aperture of many, of ground, section or volume."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter

from flgpr.calibrate import brightest_points, sharpness
from flgpr.chain.progress import Track, silent
from flgpr.formats import LINE_STARTS
from flgpr.geo.anchor import read_anchor
from flgpr.geo.export import write_geotiff
from flgpr.imaging import aperture_blocks, aperture_image
from flgpr.model import SPEED_OF_LIGHT, complete_scans, way_weights
from flgpr.store import open_run
from flgpr.store.extras import optional
from flgpr.store.outputs import whole_output
from flgpr.tasks.information import seen_ground

PathLike = str | Path
Extent = tuple[float, float] | float
ENDINGS = (".png", ".npz", ".zarr", ".tif")
# pixels at most, and where the spacing is ours to choose
_MOST = 50_000_000
_CHOSEN = 300_000
_ONE_TONE = 20e-9  # s, to which a section of a single tone goes down


@dataclass(frozen=True)
class View:
    """What to image.

    Each of ``x``, ``y``, ``z`` (lane frame, m) is a pair of limits or one value; two pairs are a plane, three a volume.
    What is not told follows from the run: the ground ahead of antennas that stand above it, else the section below the
    line, down to the end of the record; ``z`` alone bounds that section or sets the height of that ground. ``scans``
    are the first and the last that are summed, default all; ``spacing`` (m) is by default a quarter of the wavelength,
    or what gives 300 000 pixels. ``permittivity`` is that of all between antennas and pixels, 1 by default; for
    antennas that are coupled to the ground it must be told. ``half_space`` is that of ground below z = 0, at whose
    surface paths are refracted.
    Antennas farther than ``reach`` (m) from a pixel, level with the ground, do not help to image it.
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


@dataclass(frozen=True)
class Picture:
    """A focused image, its brightest points and what was chosen on the way."""

    image: xr.DataArray  #: complex64 (polarization, z, y, x)
    #: of the first polarization, brightest first: x, y, z (m), level (dB re the first), over_median (dB), and the width
    #: at -3 dB along every axis that is imaged, m; NaN where it does not fall so far
    peaks: pd.DataFrame
    spacing: float
    scans: int


def make_picture(
    run: PathLike, view: View = View(), output: Sequence[PathLike] = (), anchor: PathLike | None = None,
    points: int = 5, track: Track = silent,
) -> Picture:  # fmt: skip
    """Focus a stored run and write the picture to files: PNG, NumPy (.npz), Zarr (.zarr) or GeoTIFF (.tif, ``anchor``).

    The sum is coherent over the scans, each from its own pose and weighed by the way that it stands for. A view that
    does not fit the run, a picture of too many pixels or a file of another kind is a ValueError. A file that exists
    stays if it is this very picture, else it is a FileExistsError.
    """
    files = [Path(one) for one in output]
    for path in files:
        if path.suffix.lower() not in ENDINGS:
            raise ValueError(f"output must end in {', '.join(ENDINGS)}, got {path.name!r}")
    tie = read_anchor(anchor) if anchor is not None else None
    if any(path.suffix.lower() == ".tif" for path in files) and tie is None:
        raise ValueError("a GeoTIFF needs an anchor, got none")
    held = open_run(run)
    picture = focus(held, view, points, track, title=Path(run).name)
    pose = held["pose"].values[_scans(held, view.scans)]
    for path in files:
        if path.suffix.lower() == ".tif":
            _write_tiff(picture.image, path, tie)
        else:
            _write(picture, path, pose)
    return picture


def focus(
    held: xr.Dataset,
    view: View,
    points: int = 5,
    track: Track = silent,
    title: str = "",
    pixels: int = _CHOSEN,
) -> Picture:
    """Focus a run as :func:`make_picture` does; where the spacing is ours to choose there are about so many pixels."""
    chosen = _scans(held, view.scans)
    if view.polarizations:
        known = [str(label) for label in held["polarization"].values]
        unknown = [label for label in view.polarizations if label not in known]
        if unknown:
            raise ValueError(
                f"polarization must be one of the run's, {', '.join(known)}, got {', '.join(unknown)}"
            )
        held = held.sel(polarization=list(view.polarizations))
    pose = held["pose"].values[chosen]
    if view.permittivity is None:
        if held.attrs.get("sounding") == "ground-coupled":
            raise ValueError(
                "permittivity must be told for antennas that are coupled to the ground; `flgpr calibrate permittivity` "
                "finds it by focus"
            )
        view = replace(view, permittivity=1.0)
    axes, spacing = _axes(held, view, pose, pixels)
    grid = np.stack(np.meshgrid(axes["z"], axes["y"], axes["x"], indexing="ij")[::-1], axis=-1)
    weights = np.zeros(held.sizes["scan"])
    weights[chosen] = _weights(held, chosen)
    blocks = aperture_blocks(held, chosen)
    how: dict[str, Any] = {
        "window": view.window,
        "permittivity": view.permittivity,
        "half_space": view.half_space,
    }
    if view.band is not None:
        how["subbands"] = [view.band]
    values = aperture_image(
        held, grid, track(blocks, "scans focused", len(blocks)), weights, view.reach, **how
    )
    title = f"{held.attrs.get('title') or title}, {chosen.size} scan{'s' * (chosen.size > 1)}"
    about = {
        "title": title,
        "permittivity": view.permittivity,
        "half_space": view.half_space or 0.0,
    }
    image = xr.DataArray(
        values,
        dims=("polarization", "z", "y", "x"),
        coords={"polarization": held["polarization"].values.astype(str), **axes},
        attrs=about
        | {"window": view.window, "band_hz": list(view.band or held["frequency"].values[[0, -1]])},
        name="image",
    )
    return Picture(image, _peaks(image, points), spacing, chosen.size)


@dataclass(frozen=True)
class GroundFit:
    """Permittivity of the ground below a line, by focus."""

    permittivity: float
    contrast: float  #: sharpness there over the median of all trials
    trials: pd.DataFrame  #: permittivity, sharpness


def find_permittivity(
    run: PathLike, along: tuple[float, float] | None = None, delays: tuple[float, float] = (1e-9, 30e-9),
    trials: Sequence[float] = tuple(np.geomspace(2.0, 36.0, 41)), track: Track = silent,
) -> GroundFit:  # fmt: skip
    """Find the permittivity at which hyperbolas of a line on the ground focus best, all of them together.

    Sections of the same delays (s) and stretch of the line (m, default all) are migrated with every trial, and the
    sharpest is taken (:func:`flgpr.calibrate.sharpness`), between trials by a parabola. What does not stand out (1.3
    times the median of the trials) or lies at the edge of what was tried is refused as a ValueError.
    """
    held = open_run(run)
    scans = _scans(held, None)
    pose = held["pose"].values[scans]
    frequency = held["frequency"].values
    axis = int(np.ptp(pose[:, 1]) >= np.ptp(pose[:, 0]))
    low, high = along or (float(pose[:, axis].min()), float(pose[:, axis].max()))
    values = np.asarray(trials, dtype=np.float64)
    if (
        not (high > low and 0 <= delays[0] < delays[1])
        or values.size < 3
        or (np.diff(values) <= 0).any()
    ):
        raise ValueError(
            f"along and delays must have limits that increase, got {low:g}, {high:g} m and {delays} s"
        )
    place = np.linspace(low, high, max(round((high - low) / 0.03), 2))
    delay = np.arange(*delays, 1 / (4 * frequency[-1]))
    weights = np.zeros(held.sizes["scan"])
    weights[scans] = _weights(held, scans)
    blocks = aperture_blocks(held, scans)
    found = []
    for value in track(values, "permittivities tried", values.size):
        points = np.zeros((delay.size, place.size, 3))
        points[..., 0] = pose[:, 0].mean()
        points[..., 1] = pose[:, 1].mean()
        points[..., axis] = place
        points[..., 2] = -delay[:, None] * SPEED_OF_LIGHT / math.sqrt(value) / 2
        image = aperture_image(
            held, points, blocks, weights, permittivity=float(value), window="hann", tolerance=1e-2
        )
        found.append(sharpness(image))
    sharp = np.array(found)
    best = int(sharp.argmax())
    contrast = float(sharp.max() / np.median(sharp))
    if best in (0, values.size - 1):
        raise ValueError(
            f"permittivity lies at or beyond the edge of what was tried, {values[0]:g} to {values[-1]:g}"
        )
    if contrast < 1.3:
        raise ValueError(
            f"no permittivity stands out: the sharpest is {contrast:.2f} times the median, 1.3 are needed"
        )
    curve = np.polyfit(np.log(values[best - 1 : best + 2]), sharp[best - 1 : best + 2], 2)
    table = pd.DataFrame({"permittivity": values, "sharpness": sharp})
    return GroundFit(float(np.exp(-curve[1] / (2 * curve[0]))), contrast, table)


def _weights(run: xr.Dataset, scans: NDArray[np.intp]) -> NDArray[np.float64]:
    """Return the share of the way that each scan stands for; in a survey, of the way along its own line."""
    place = run["pose"].values[scans, :3]
    starts = run.attrs.get(LINE_STARTS)
    if not starts:
        return way_weights(place)
    line = np.searchsorted(np.asarray(starts), scans, side="right")
    weights = np.zeros(scans.size)
    for one in np.unique(line):
        own = line == one
        steps = np.hypot(*np.diff(place[own, :2], axis=0).T)
        weights[own] = way_weights(place[own]) * (steps.mean() if steps.size else 0.0)
    return np.asarray(weights / weights.mean()) if weights.sum() > 0 else np.ones(scans.size)


def _scans(run: xr.Dataset, limits: tuple[int, int] | None) -> NDArray[np.intp]:
    """Give the complete scans within limits, both counted."""
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


def _axes(
    run: xr.Dataset, view: View, pose: NDArray[np.float64], pixels: int
) -> tuple[dict[str, NDArray[np.float64]], float]:
    """Choose the pixels' axes, m, and their spacing."""
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
    if math.prod(counts.values()) > _MOST or min(counts.values()) < 2:
        told_of = " x ".join(f"{axis} {count}" for axis, count in counts.items())
        raise ValueError(
            f"spacing must give 2 pixels or more along an axis and {_MOST:g} in all, got {told_of}"
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


def _peaks(image: xr.DataArray, count: int) -> pd.DataFrame:
    """Find the brightest local maxima of the first polarization, apart by more than its range resolution."""
    level = np.abs(image.values[0]).astype(np.float64)
    axes = {axis: image[axis].values for axis in ("z", "y", "x")}
    grid = np.stack(np.meshgrid(*axes.values(), indexing="ij")[::-1], axis=-1)
    middle = float(np.median(level))
    top = float(level.max())
    rows: list[dict[str, float]] = []
    if top == 0:
        return pd.DataFrame(columns=["x", "y", "z", "level", "over_median"])
    band = image.attrs["band_hz"]
    apart = SPEED_OF_LIGHT / max(band[1] - band[0], band[1] / 4)
    maxima = np.where(maximum_filter(level, 3) == level, level, 0.0)
    for x, y, z, value in brightest_points(maxima, grid, count, apart):
        if value == 0:
            break
        row = {"x": x, "y": y, "z": z, "level": 20 * math.log10(value / top)}
        row["over_median"] = 20 * math.log10(value / middle) if middle > 0 else math.inf
        place = tuple(
            int(np.argmin(np.abs(axes[axis] - at)))
            for axis, at in zip("zyx", (z, y, x), strict=True)
        )
        for number, (axis, values) in reversed(list(enumerate(axes.items()))):
            if values.size > 1:
                line = level[
                    tuple(slice(None) if k == number else one for k, one in enumerate(place))
                ]
                row[f"width_{axis}"] = _width(values, line, place[number])
        rows.append(row)
    return pd.DataFrame(rows)


def _width(axis: NDArray[np.float64], line: NDArray[np.float64], top: int) -> float:
    """Width of a peak at half its power, m, between pixels; NaN where it does not fall so far."""
    half = line[top] / math.sqrt(2)
    ends = []
    for step in (-1, 1):
        k = top
        while 0 <= k + step < line.size and line[k + step] > half:
            k += step
        if not 0 <= k + step < line.size:
            return math.nan
        part = (line[k] - half) / (line[k] - line[k + step])
        ends.append(axis[k] + part * (axis[k + step] - axis[k]))
    return float(ends[1] - ends[0])


def _write(picture: Picture, path: Path, pose: NDArray[np.float64]) -> None:
    image = picture.image
    with whole_output(path) as partial:
        if path.suffix.lower() == ".zarr":
            image.to_dataset("polarization").to_zarr(partial, zarr_format=2, consolidated=True)
        elif path.suffix.lower() == ".png":
            from flgpr.report.figures import image_figure

            image_figure(image, picture.peaks, pose).savefig(
                partial, dpi=110, format="png", metadata={"Software": None}
            )
        else:
            np.savez(
                partial,
                image=image.values,
                **{str(name): axis.values for name, axis in image.coords.items()},
            )


def _write_tiff(image: xr.DataArray, path: Path, tie: Any) -> None:
    if image.sizes["z"] > 1 or min(image.sizes["x"], image.sizes["y"]) < 2:
        raise ValueError("a GeoTIFF must be of level ground, with limits of x and y and one z")
    optional("rasterio", "gis")
    level = image.isel(z=0).copy(data=np.abs(image.values[:, 0]))
    flat = level.expand_dims(subband=["all"], axis=1)
    with whole_output(path) as partial:
        write_geotiff(flat, partial, tie, str(image.attrs["title"]))
