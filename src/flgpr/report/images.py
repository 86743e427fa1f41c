"""Figures of focused images, depth slices and arrays, and of radargrams: traces over time."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pandas as pd
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from numpy.typing import NDArray

from flgpr.types import FloatArray, IndexArray, IntArray

_PLANES = (("x", "y"), ("x", "z"), ("y", "z"))
_FINE_CELLS = 60  # across a picture, by which places that fill an area are told
_MOST_CELLS_OF_A_WAY = 400  # of these cells, that hold the places of a way
_COARSE_CELLS = 16  # across a picture, a place of each of which is left
_COLUMNS = 4  # of slices
_SLICE_WIDTH = 3.1  # inches
_SLICE_RATIOS = (0.4, 2.2)  # length over width between which slices are drawn to scale
# largest size of a panel, inches
_WIDE = 7.5
_HIGH = 6.0
_SPAN = 40.0  # dB of the scale
_RATIOS = (0.12, 2.5)  # height over width between which planes are drawn to scale
_MARGIN = 0.08  # of a panel, beside whose edge a number would be cut off
_ROWS = 600  # of the picture, about
_RANGE = 60.0  # dB that the colours cover
_UNEVEN = 0.02  # of the mean trace spacing; more than that is not drawn as an even axis
_CLIP = 99.0  # per cent of the amplitudes that the grey scale covers
_TICKS = 8


def image_figure(image: xr.DataArray, peaks: pd.DataFrame, pose: FloatArray) -> Figure:
    """Draw an image in planes, each polarization in dB re its strongest pixel.

    An axis of one value is left out; a volume is drawn as its strongest pixels along each axis.

    Parameters
    ----------
    image : xarray.DataArray
        Complex image (polarization, z, y, x).
    peaks : pandas.DataFrame
        Peaks with ``x``, ``y``, ``z``, m, which are numbered in the first polarization's panels.
    pose : (scan, 6) ndarray of float
        Poses, which are drawn where they lie in a panel, m and rad.

    Returns
    -------
    matplotlib.figure.Figure
        A row per polarization and a column per plane.
    """
    labels = [str(label) for label in image["polarization"].values]
    wide_axes = [axis for axis in "xyz" if image.sizes[axis] > 1]
    planes = [plane for plane in _PLANES if set(plane) <= set(wide_axes)]
    width, height = _panel_size(image, planes[0])
    size = (width * len(planes) + 1.6, (height + 1.1) * len(labels))
    figure = Figure(figsize=size, layout="compressed")
    panels = figure.subplots(len(labels), len(planes), squeeze=False)
    for number, (label, row) in enumerate(zip(labels, panels, strict=True)):
        level = np.abs(image.values[number])
        level /= max(float(level.max()), np.finfo(float).tiny)
        for axes, plane in zip(row, planes, strict=True):
            collapsed = tuple(k for k, axis in enumerate("zyx") if axis not in plane)
            mesh = _draw_level(axes, image, level.max(axis=collapsed), plane, _SPAN, _RATIOS)
            _draw_poses(axes, pose, plane)
            axes.set(xlabel=f"{plane[0]} (m)", ylabel=f"{plane[1]} (m)")
            if number == 0:
                points = peaks[list(plane)].to_numpy()
                _number_points(axes, points)
        bar = figure.colorbar(mesh, ax=row[-1], shrink=0.8, pad=0.02)
        # On two lines, so that the label fits the bar of a low panel.
        bar.set_label(f"{label}, dB re its\nstrongest pixel", fontsize=9)
    figure.suptitle(_image_title(image, wide_axes), fontsize=10)
    return figure


def _panel_size(image: xr.DataArray, plane: tuple[str, str]) -> tuple[float, float]:
    """Return width and height of the panel of a plane, inches."""
    across, up = plane
    extent_across = max(float(np.ptp(image[across].values)), 1e-9)
    extent_up = max(float(np.ptp(image[up].values)), 1e-9)
    ratio = float(np.clip(extent_up / extent_across, *_RATIOS))
    width = min(_WIDE, _HIGH / ratio)
    return width, width * ratio


def _image_title(image: xr.DataArray, wide_axes: Sequence[str]) -> str:
    """Return the title of an image, with the value of each axis that has a single one."""
    title = str(image.attrs.get("title", ""))
    texts = [title] if title else []
    for axis in "xyz":
        if axis not in wide_axes:
            texts.append(f"{axis} = {image[axis].values[0]:g} m")
    return ", ".join(texts)


def _draw_level(
    axes: Axes,
    image: xr.DataArray,
    level: NDArray[np.floating],
    plane: tuple[str, str],
    span: float,
    ratios: tuple[float, float],
) -> AxesImage:
    """Draw a level in a plane of an image, dB re one; to scale between two ratios of its sides."""
    u = image[plane[0]].values
    v = image[plane[1]].values
    # Coordinates are those of pixel centres.
    half_du = np.diff(u).mean() / 2
    half_dv = np.diff(v).mean() / 2
    is_to_scale = ratios[0] < np.ptp(v) / np.ptp(u) < ratios[1]
    return axes.imshow(
        20 * np.log10(np.maximum(level, 1e-9)),
        origin="lower",
        extent=(u[0] - half_du, u[-1] + half_du, v[0] - half_dv, v[-1] + half_dv),
        cmap="magma",
        vmin=-span,
        vmax=0,
        aspect="equal" if is_to_scale else "auto",
        interpolation="nearest",
    )


def _draw_poses(axes: Axes, pose: FloatArray, plane: tuple[str, str]) -> None:
    """Draw poses as dots, without changing the limits of the axes."""
    limits = axes.axis()
    places = pose[:, ["xyz".index(axis) for axis in plane]]
    axes.plot(*_thinned(places, limits).T, ".", color="#4fc3f7", markersize=2)
    axes.axis(limits)


def _thinned(places: FloatArray, limits: tuple[float, float, float, float]) -> FloatArray:
    """Return places (place, 2) that do not hide the picture between limits of its axes.

    A way is drawn as it is. Of places that fill an area, as those of a raster do, a few are left.
    """
    low = np.array(limits[::2])
    span = np.maximum(np.array(limits[1::2]) - low, np.finfo(float).tiny)

    def first_of_cells(cells: int) -> IndexArray:
        cell = np.floor((places - low) / span * cells).astype(np.int64)
        return np.unique(cell, axis=0, return_index=True)[1]

    if len(first_of_cells(_FINE_CELLS)) <= _MOST_CELLS_OF_A_WAY:
        return places
    return places[np.sort(first_of_cells(_COARSE_CELLS))]


def _number_points(axes: Axes, points: FloatArray) -> None:
    """Circle points (point, 2) and number them from 1 on.

    Each number stands on the side where the panel goes on.
    """
    left, right, bottom, top = axes.axis()
    for number, (across, up) in enumerate(points.tolist(), 1):
        near_right = across > right - _MARGIN * (right - left)
        near_top = up > top - _MARGIN * (top - bottom)
        text = axes.annotate(
            str(number),
            (across, up),
            xytext=(-6 if near_right else 6, -6 if near_top else 6),
            textcoords="offset points",
            ha="right" if near_right else "left",
            va="top" if near_top else "bottom",
            color="white",
            fontsize=8,
        )
        text.set_in_layout(False)  # what lies in the panel moves no label out of the figure
        axes.plot(across, up, "o", mfc="none", mec="white", markersize=9)
    axes.axis((left, right, bottom, top))


def slices_figure(image: xr.DataArray, pose: FloatArray, span: float = 25.0) -> Figure:
    """Draw level slices of an image of its first polarization, side by side.

    Parameters
    ----------
    image : xarray.DataArray
        Complex image (polarization, z, y, x).
    pose : (scan, 6) ndarray of float
        Poses, which are drawn as dots, m and rad.
    span : float
        Range of the common scale below the strongest pixel of all slices, dB.

    Returns
    -------
    matplotlib.figure.Figure
        A panel per slice, at most four side by side.
    """
    level = np.abs(image.values[0]).astype(np.float64)
    count = level.shape[0]
    columns = min(_COLUMNS, count)
    rows = math.ceil(count / columns)
    length_by_width = float(np.ptp(image["y"].values) / np.ptp(image["x"].values))
    panel_ratio = float(np.clip(length_by_width, *_SLICE_RATIOS))
    width = _SLICE_WIDTH * columns + 1.4
    height = (_SLICE_WIDTH * panel_ratio + 0.7) * rows + 0.5
    figure = Figure(figsize=(width, height), layout="compressed")
    panels = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=True)

    # One scale for all slices: the strongest pixel of all of them is 0 dB.
    top = max(float(level.max()), np.finfo(float).tiny)
    for axes in panels.ravel()[count:]:
        axes.set_axis_off()
    for number, axes in enumerate(panels.ravel()[:count]):
        mesh = _draw_level(axes, image, level[number] / top, ("x", "y"), span, _SLICE_RATIOS)
        places = _thinned(pose[:, :2], axes.axis())
        axes.plot(*places.T, ".", color="#4fc3f7", markersize=0.8)
        depth = -float(image["z"][number])
        axes.set_title(f"{depth:g} m below", fontsize=9)
        if number % columns == 0:
            axes.set_ylabel("y (m)")
        if number >= count - columns:
            axes.set_xlabel("x (m)")

    polarization = image["polarization"].values[0]
    figure.colorbar(
        mesh,
        ax=panels,
        label=f"{polarization}, dB re the strongest pixel",
        shrink=0.7,
    )
    figure.suptitle(str(image.attrs.get("title", "")), fontsize=10)
    return figure


def opened_figure(signal: NDArray[np.number], name: str) -> Figure:
    """Draw the level of an array: its last axis to the right, all others downwards.

    Parameters
    ----------
    signal : (..., n) ndarray
        The array that seems to be the signal.
    name : str
        Its name.

    Returns
    -------
    matplotlib.figure.Figure
        The figure.
    """
    rows = signal.reshape(-1, signal.shape[-1])
    rows = rows[:: max(1, len(rows) // _ROWS)]
    with np.errstate(divide="ignore", invalid="ignore"):
        levels = 20 * np.log10(np.abs(rows.astype(np.complex128)))
    finite = levels[np.isfinite(levels)]
    top = float(finite.max()) if finite.size else 0.0
    figure = Figure(figsize=(9.5, 5.6), layout="constrained")
    axes = figure.subplots()
    image = axes.imshow(
        levels, cmap="viridis", vmin=top - _RANGE, vmax=top, aspect="auto", interpolation="nearest"
    )
    shape = " x ".join(map(str, signal.shape))
    axes.set(
        xlabel="index along the last axis",
        ylabel="all other axes, in their order",
        title=f"{name}: {shape}",
    )
    figure.colorbar(image, label="magnitude (dB)")
    return figure


def radargram_figure(
    values: FloatArray,
    delay: FloatArray,
    number: IntArray,
    distance: FloatArray | None,
    depth: FloatArray | None,
    title: str,
    unit: str,
    steps: Sequence[str],
) -> Figure:
    """Draw traces in grey over two-way time, with a second axis of depth if there is one.

    Traces stand side by side at equal widths. Where their distances are even, these are the axis
    below; otherwise that axis has the traces' numbers, and the axis above has the distances at some
    of them. Samples without data are white. The grey scale ends at the 99th percentile of the
    amplitudes; pointed ends of its bar say that there are larger ones.

    Parameters
    ----------
    values : (trace, sample) ndarray of float
        Amplitudes; NaN where there are no data.
    delay : (sample,) ndarray of float
        Two-way time, s.
    number : (trace,) ndarray of int
        Numbers of the traces.
    distance : (trace,) ndarray of float or None
        Distance along the line, m.
    depth : (sample,) ndarray of float or None
        Depth, m.
    title : str
        Title of the figure.
    unit : str
        Label of the grey scale.
    steps : sequence of str
        Processing steps, for the title.

    Returns
    -------
    matplotlib.figure.Figure
        The figure.
    """
    figure = Figure(figsize=(9.5, 5.6), layout="constrained")
    axes = figure.subplots()
    amplitudes = np.abs(values[np.isfinite(values)])
    top = _end_of_scale(amplitudes)
    time = delay * 1e9  # ns
    half_sample = 0.5 * (time[1] - time[0])
    left, right, label = _across(number, distance)
    image = axes.imshow(
        values.T,
        extent=(left, right, time[-1] + half_sample, time[0] - half_sample),
        cmap="gray",
        vmin=-top,
        vmax=top,
        aspect="auto",
        interpolation="nearest" if len(values) < 1500 else "antialiased",
    )
    axes.set(xlabel=label, ylabel="two-way time (ns)")
    axes.set_title(f"{title}\n{'; '.join(steps) or 'as recorded'}", fontsize=10)
    if distance is not None and not _is_even(distance):
        _add_distance_axis(axes, number, distance)
    if depth is not None:
        _add_depth_axis(axes, time, depth)
    is_clipped = bool((amplitudes > top).any())
    figure.colorbar(
        image,
        ax=axes,
        label=unit,
        shrink=0.8,
        pad=0.02 if depth is None else 0.03,
        extend="both" if is_clipped else "neither",
    )
    return figure


def _end_of_scale(amplitudes: FloatArray) -> float:
    """Return the amplitude at which the grey scale ends."""
    top = float(np.percentile(amplitudes, _CLIP)) if amplitudes.size else 0.0
    if top > 0:
        return top
    # A silent line, or one with echoes in fewer than a hundredth of its samples.
    return float(amplitudes.max(initial=0.0)) or 1.0


def _is_even(distance: FloatArray) -> bool:
    """Return whether distances grow in steps that are nearly equal."""
    steps = np.diff(distance)
    if not steps.size or not np.isfinite(distance).all():
        return False
    mean = float(steps.mean())
    return bool(mean > 0 and np.abs(steps - mean).max() <= _UNEVEN * mean)


def _across(number: IntArray, distance: FloatArray | None) -> tuple[float, float, str]:
    """Return the outer edges of the first and the last trace and the label of the axis below."""
    if distance is None or not _is_even(distance):
        return float(number[0]) - 0.5, float(number[-1]) + 0.5, "trace"
    first = float(distance[0])
    last = float(distance[-1])
    half_spacing = 0.5 * (last - first) / (distance.size - 1)
    return first - half_spacing, last + half_spacing, "distance along the line (m)"


def _add_distance_axis(axes: Axes, number: IntArray, distance: FloatArray) -> None:
    """Add an axis above with the distances of some traces."""
    ticks = np.linspace(0, number.size - 1, min(_TICKS, number.size))
    chosen = np.unique(ticks.round().astype(int))
    above = axes.secondary_xaxis("top")
    above.set_xticks(number[chosen], [f"{value:.4g}" for value in distance[chosen]])
    above.set_xlabel("distance along the line (m), uneven")


def _add_depth_axis(axes: Axes, time: FloatArray, depth: FloatArray) -> None:
    """Add an axis of depth to the right; depth is zero at time zero."""
    metres_per_ns = float((depth[-1] - depth[0]) / (time[-1] - time[0]))

    def to_depth(nanoseconds: FloatArray) -> FloatArray:
        return nanoseconds * metres_per_ns

    def to_time(metres: FloatArray) -> FloatArray:
        return metres / metres_per_ns

    functions = (to_depth, to_time)
    depth_axis = axes.secondary_yaxis("right", functions=functions)  # type: ignore[arg-type]
    depth_axis.set_ylabel("depth (m)")
