"""The figure of a radargram: traces side by side, time downwards."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
_UNEVEN = 0.02  # of the mean trace spacing; more than that is not drawn as an even axis
_CLIP = 99.0  # per cent of the amplitudes that the grey scale tells apart
_TICKS = 8


def radargram_figure(
    values: FloatArray,
    delay: FloatArray,
    number: NDArray[np.int64],
    distance: FloatArray | None,
    depth: FloatArray | None,
    title: str,
    unit: str,
    steps: Sequence[str],
) -> Figure:
    """Draw traces (trace, sample) in grey over two-way time, s, with a second axis of depth, m, if there is one.

    Traces stand side by side at equal widths. Where their distances (trace,), m, are even, they are the axis below;
    where they are not, that is the traces' numbers, and the axis above has the distances at some of them. What holds
    no data is left white. The grey scale ends at the 99th percentile of the amplitudes;
    pointed ends of its bar tell that there are larger ones.
    """
    figure = Figure(figsize=(9.5, 5.6), layout="constrained")
    axes = figure.subplots()
    known = np.abs(values[np.isfinite(values)])
    top = float(np.percentile(known, _CLIP)) if known.size else 0.0
    if top == 0:  # a silent line, or one with fewer than a hundredth of echoes
        top = float(known.max(initial=0.0)) or 1.0
    time = delay * 1e9
    half_sample = 0.5 * (time[1] - time[0])
    left, right, label = _across(number, distance)
    drawn = axes.imshow(
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
    if distance is not None and not _even(distance):
        _distances_above(axes, number, distance)
    if depth is not None:
        _depth_beside(axes, time, depth)
    clipped = bool((known > top).any())
    figure.colorbar(
        drawn,
        ax=axes,
        label=unit,
        shrink=0.8,
        pad=0.02 if depth is None else 0.03,
        extend="both" if clipped else "neither",
    )
    return figure


def _even(distance: FloatArray) -> bool:
    steps = np.diff(distance)
    if not steps.size or not np.isfinite(distance).all():
        return False
    mean = float(steps.mean())
    return bool(mean > 0 and np.abs(steps - mean).max() <= _UNEVEN * mean)


def _across(number: NDArray[np.int64], distance: FloatArray | None) -> tuple[float, float, str]:
    """Return the outer edges of the first and the last trace and the label of the axis below."""
    if distance is not None and _even(distance):
        half = 0.5 * float(distance[-1] - distance[0]) / (distance.size - 1)
        return float(distance[0]) - half, float(distance[-1]) + half, "distance along the line (m)"
    return float(number[0]) - 0.5, float(number[-1]) + 0.5, "trace"


def _distances_above(axes: Axes, number: NDArray[np.int64], distance: FloatArray) -> None:
    """Write the distances of some traces on an axis above."""
    chosen = np.unique(
        np.linspace(0, number.size - 1, min(_TICKS, number.size)).round().astype(int)
    )
    above = axes.secondary_xaxis("top")
    above.set_xticks(number[chosen], [f"{value:.4g}" for value in distance[chosen]])
    above.set_xlabel("distance along the line (m), uneven")


def _depth_beside(axes: Axes, time: FloatArray, depth: FloatArray) -> None:
    """Draw an axis of depth beside that of time; both are zero at time zero."""
    metres_per_ns = float((depth[-1] - depth[0]) / (time[-1] - time[0]))

    def to_depth(at: FloatArray) -> FloatArray:
        return at * metres_per_ns

    def to_time(at: FloatArray) -> FloatArray:
        return at / metres_per_ns

    beside = axes.secondary_yaxis("right", functions=(to_depth, to_time))  # type: ignore[arg-type]
    beside.set_ylabel("depth (m)")
