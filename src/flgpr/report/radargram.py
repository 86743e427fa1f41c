"""The figure of a radargram: traces side by side, time downwards."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from flgpr.types import FloatArray, IntArray

_UNEVEN = 0.02  # of the mean trace spacing; more than that is not drawn as an even axis
_CLIP = 99.0  # per cent of the amplitudes that the grey scale covers
_TICKS = 8


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
