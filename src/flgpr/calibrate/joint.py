"""Range bias, and with it the clock offset, from reflectors at known places, and how far the answer can be trusted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
import xarray as xr
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import ArrayLike

from flgpr.calibrate.clock import Operator, track_trials, with_track
from flgpr.calibrate.profiles import fields_over_bias, lattice, resolution
from flgpr.model import SPEED_OF_LIGHT, antennas_in_lane, check_run
from flgpr.model.aperture import synthetic_aperture
from flgpr.model.arrays import FloatArray
from flgpr.model.phase import lengthen
from flgpr.model.track import poses_at

STANDS_OUT = 4.0
"""Least height of a trusted peak over the best answer elsewhere, dB."""
# moves to either side that chance is told by; coarsest resolution they allow for, m
_MOVES = 8
_COARSEST = 2.0
_SUMS = 4_000_000  # held at a time, 96 MB with their powers
DEFAULT_SEARCH = 3.0
"""How far to either side of zero a range bias is looked for, m, where the unambiguous range allows it."""


@dataclass(frozen=True)
class BiasFit:
    """Range bias of a radar, with the clock offset where that was looked for as well, and how good they are."""

    bias: float  #: by how much one-way ranges are measured too long, m
    # : one standard deviation, m, from the echoes' height over the background and their spread
    bias_sigma: float
    offset: (
        float | None
    )  #: time on the track's clock less the radar's, s; None where the run's poses were taken
    offset_sigma: float | None  #: one standard deviation, s; 0 of a single offset tried
    #: height of the peak over the best answer elsewhere, two range resolutions away or more, and over the median, dB
    over_runner_up: float
    over_median: float
    runner_up: float  #: bias of the best answer elsewhere, m
    over_moved: float  #: height of the peak over the best answer for reflectors moved sideways, dB
    spread: float  #: greatest less least bias that single reflectors tell, m; 0 for one alone
    searched: tuple[float, float]  #: least and greatest bias tried, m
    #: per reflector: its place x, y, z, where its image peaks (x_peak, y_peak), and the bias it tells, m
    points: pd.DataFrame
    doubt: str  #: why the answer is not to be trusted; empty if it is


def estimate_range_bias(
    run: xr.Dataset,
    points: ArrayLike,
    operator: Operator,
    search: float | None = None,
    tolerance: float = 0.15,
) -> BiasFit:
    """Find the range bias, at most ``search`` m to either side of zero, as :func:`estimate_joint` at the run's poses.

    The default is 3 m, or what the unambiguous range leaves if that is less.
    """
    if search is None:
        search = min(DEFAULT_SEARCH, 0.49 * unambiguous_range(run["frequency"].values))
    return estimate_joint(run, points, operator, (-search, search), tolerance=tolerance)


def unambiguous_range(frequency: ArrayLike) -> float:
    """One-way range after which a run's ranges repeat, m."""
    return SPEED_OF_LIGHT / lattice(frequency)[0] / 2


def estimate_joint(
    run: xr.Dataset, points: ArrayLike, operator: Operator, biases: tuple[float, float],
    track: pd.DataFrame | None = None, offsets: ArrayLike = (), tolerance: float = 0.15, refine: int = 4,
) -> BiasFit:  # fmt: skip
    """Find the range bias, and the clock offset of a track with it, from reflectors at known places.

    For every offset the scans are summed coherently at each reflector for all biases at once. The
    power there over its median is multiplied over the reflectors, and the product's peak is
    refined. An image around each reflector then tells a bias of its own: by how much its brightest
    pixel lies farther from the aperture than the reflector. What stands still in the run should be
    out of it: see :func:`flgpr.clutter.subtract_mean_scan`.

    Parameters
    ----------
    run : xarray.Dataset
        A run, with times if there is a track; one without a complete scan is a ValueError.
    points : (reflector, 3) array_like
        Places of the reflectors in the lane frame, m, at least one.
    operator : callable
        ``flgpr.imaging.ImagingOperator``.
    biases : tuple of float
        Least and greatest bias, m; ranges must not repeat within them.
    track, offsets : DataFrame, (trial,) array_like
        Track of the array's reference point and evenly spaced clock offsets to try, s. Those that
        leave the track are passed over; if all do, it is a ValueError. Without a track the run's
        poses are taken as they are.
    tolerance : float
        How far from a reflector's place, across the line of sight, its echo may come from, and how
        far apart the biases of two reflectors may lie, m.
    refine : int
        How often the offsets' step is halved around the best.
    """
    check_run(run)
    places = np.asarray(points, dtype=np.float64)
    cell = resolution(run["frequency"].values)
    _check(places, biases, tolerance, cell, unambiguous_range(run["frequency"].values))
    run = run.compute()
    way = pd.DataFrame() if track is None else track
    when, poses = (
        (np.zeros(1), [run["pose"].values]) if track is None else track_trials(run, way, offsets)
    )
    across, fine = _across(run, poses[len(poses) // 2], places)
    # A quarter wavelength shows every lobe of whatever aperture.
    lines = (
        places[:, None]
        + _steps(tolerance, SPEED_OF_LIGHT / float(run["frequency"].values[-1]) / 4) * across
    )
    level, bias = _levels(run, poses, lines, biases)
    background = np.maximum(np.median(level, axis=(0, 2)), np.finfo(np.float32).tiny)
    score = _score(level, background)
    at = int(score.max(axis=1).argmax())
    step = float(np.diff(when).mean()) if when.size > 1 else 0.0
    edge = step > 0 and at in (0, when.size - 1)
    best = float(when[at])
    curve = score[at]
    width = step
    for _ in range(refine if step else 0):
        width /= 2
        around, poses = track_trials(run, way, [best - width, best, best + width])
        close = _score(_levels(run, poses, lines, biases)[0], background)
        at = int(close.max(axis=1).argmax())
        best = float(around[at])
        curve = close[at]
    found = run if track is None else with_track(run, track, best)
    peak = int(curve.argmax())
    height = float(curve[peak])
    over_bias = score.max(axis=0)
    elsewhere = np.abs(bias - bias[peak]) > 2 * cell
    rival = int(np.where(elsewhere, over_bias, -np.inf).argmax())
    moved = _score_moved(found, places, across, fine, tolerance, biases, background)
    noise = np.maximum(level[..., elsewhere].mean(axis=(0, 2)), background)
    middle = float(
        np.clip(best, when[0] + step / 2, when[-1] - step / 2)
    )  # both neighbours inside the track
    sigma = (
        (np.inf, np.inf)
        if edge
        else _sigma(found, track, middle, step / 2, lines, (biases, peak), noise)
    )
    table = _at_reflectors(found, places, operator, _summit(curve, bias, peak), tolerance)
    single = table["bias"].to_numpy()
    if single.size > 1:
        sigma = float(np.hypot(sigma[0], single.std(ddof=1) / np.sqrt(single.size))), sigma[1]
    fit = BiasFit(
        float(single.mean()), sigma[0], None if track is None else best, None if track is None else sigma[1],
        height - float(over_bias[rival]), height - float(np.median(over_bias)),
        float(bias[rival]), height - moved, float(np.ptp(single)), (float(biases[0]), float(biases[1])), table, "",
    )  # fmt: skip
    return replace(fit, doubt=_doubt(fit, edge, tolerance, cell))


def _check(
    places: FloatArray, biases: tuple[float, float], tolerance: float, cell: float, most: float
) -> None:
    """Refuse a search that cannot be made: ``cell`` is the range resolution, ``most`` the unambiguous range, m."""
    if (
        places.ndim != 2
        or places.shape[1:] != (3,)
        or not len(places)
        or not np.isfinite(places).all()
    ):
        raise ValueError(
            f"points must be finite with the shape (reflector, 3) and at least one, got {places.shape}"
        )
    low, high = biases
    if not (np.isfinite(biases).all() and 8 * cell <= high - low <= most):
        raise ValueError(
            f"biases must span from {8 * cell:.2g} m, eight times the range resolution, to {most:.3g} m, after which "
            f"the ranges of this run repeat; got {low:g} to {high:g} m"
        )
    if not 0 < tolerance <= _COARSEST:
        raise ValueError(
            f"tolerance must be positive and at most {_COARSEST:g} m, got {tolerance:g}"
        )


def _doubt(fit: BiasFit, edge: bool, tolerance: float, cell: float) -> str:
    """Say what speaks against an answer; nothing if all is well."""
    low, high = fit.searched
    if edge:
        return f"the best clock offset, {fit.offset:.3f} s, lies at the edge of those tried: look farther"
    if not low + cell < fit.bias < high - cell:
        return f"the best bias, {fit.bias:.2f} m, lies at the edge of {low:g} to {high:g} m: look farther"
    if fit.over_runner_up < STANDS_OUT:
        return (
            f"no bias stands out from {low:g} to {high:g} m: {fit.bias:.2f} m is but {fit.over_runner_up:.1f} dB "
            f"better than {fit.runner_up:.2f} m, {STANDS_OUT:g} dB are asked for"
        )
    if fit.over_moved < STANDS_OUT:
        return (
            f"{fit.bias:.2f} m is but {fit.over_moved:.1f} dB better than the best answer for reflectors moved "
            f"sideways, {STANDS_OUT:g} dB are asked for: are their places right, and nothing about as bright near them?"
        )
    if fit.spread > tolerance:
        told = ", ".join(f"{one:.2f}" for one in fit.points["bias"])
        return f"the reflectors disagree: they tell {told} m, more than {tolerance:g} m apart"
    if not np.isfinite([fit.bias_sigma, fit.offset_sigma or 0.0]).all():
        return "the echoes do not tell clock offset and bias apart: they are as good at others along a line of them"
    return ""


def _across(run: xr.Dataset, pose: FloatArray, places: FloatArray) -> tuple[FloatArray, float]:
    """Find unit vectors (reflector, 1, 3) on the level across the line of sight, and the coarsest resolution."""
    tx, rx = antennas_in_lane(run, pose)
    seen = places - 0.5 * (tx.mean(axis=0) + rx.mean(axis=0))
    across = np.stack([seen[:, 1], -seen[:, 0], np.zeros(len(places))], axis=1)
    size = np.linalg.norm(across, axis=1, keepdims=True)
    across = np.where(size > 0, across / np.where(size > 0, size, 1.0), [1.0, 0.0, 0.0])
    spread = [
        np.ptp(sum((end - place) @ one / np.linalg.norm(end - place, axis=1) for end in (tx, rx)))
        for place, one in zip(places, across, strict=True)
    ]
    middle = SPEED_OF_LIGHT / float(run["frequency"].values.mean())
    return across[:, None], float(min(middle / max(min(spread), 1e-9), _COARSEST))


def _steps(reach: float, step: float) -> FloatArray:
    """Even steps (step, 1) of at most ``step`` from minus to plus ``reach``, with one at zero."""
    half = int(np.ceil(reach / step))
    return np.linspace(-reach, reach, 2 * half + 1)[:, None]


def _score_moved(
    run: xr.Dataset, places: FloatArray, across: FloatArray, fine: float, tolerance: float,
    biases: tuple[float, float], background: FloatArray,
) -> float:  # fmt: skip
    """Best score of reflectors that are all moved sideways, out of reach of their own echoes: what chance can do."""
    clear = 2 * tolerance + 1.5 * fine
    reach = clear + _MOVES * max(2 * tolerance, fine)
    steps = _steps(reach, min(fine / 4, tolerance))
    power, _ = _powers(run, [run["pose"].values], places[:, None] + steps * across, biases)
    half = round(tolerance / float(steps[1, 0] - steps[0, 0]))
    level = sliding_window_view(power[0], 2 * half + 1, axis=1).max(axis=-1)
    away = np.abs(steps[half : steps.size - half, 0]) > clear
    return float(_score(level[:, away].swapaxes(0, 1), background).max())


def _powers(
    run: xr.Dataset, poses: Sequence[ArrayLike], points: FloatArray, biases: tuple[float, float]
) -> tuple[FloatArray, FloatArray]:
    """Power (trial, reflector, point, bias) at points (reflector, point, 3), and the biases."""
    field, bias = fields_over_bias(run, poses, points.reshape(-1, 3), biases)
    power = (field.real.astype(np.float64) ** 2 + field.imag.astype(np.float64) ** 2).sum(axis=1)
    return power.reshape(len(power), *points.shape[:2], bias.size), bias


def _levels(
    run: xr.Dataset, poses: Sequence[ArrayLike], lines: FloatArray, biases: tuple[float, float]
) -> tuple[FloatArray, FloatArray]:
    """Power (trial, reflector, bias) at the brightest point of each reflector's line, and biases."""
    held = (
        lines.shape[0]
        * lines.shape[1]
        * (biases[1] - biases[0])
        / resolution(run["frequency"].values)
        * 8
    )
    few = max(1, int(_SUMS / held))  # trials at a time
    parts = [_powers(run, poses[k : k + few], lines, biases) for k in range(0, len(poses), few)]
    return np.concatenate([power.max(axis=2) for power, _ in parts]), parts[0][1]


def _score(level: FloatArray, background: FloatArray) -> FloatArray:
    """Mean over reflectors of the power over the background, dB: (trial, bias)."""
    floor = np.finfo(np.float32).tiny
    return np.asarray(10 * np.log10(np.maximum(level / background[:, None], floor)).mean(axis=1))


def _summit(curve: FloatArray, bias: FloatArray, peak: int) -> float:
    """Bias at the top of the parabola through a peak and its neighbours, so that the bias' grid does not matter."""
    if not 0 < peak < bias.size - 1:
        return float(bias[peak])
    left, top, right = curve[peak - 1 : peak + 2]
    bend = left - 2 * top + right
    return float(
        bias[peak] + (bias[1] - bias[0]) * (left - right) / (2 * bend if bend < 0 else np.inf)
    )


def _sigma(
    run: xr.Dataset, track: pd.DataFrame | None, offset: float, step: float, lines: FloatArray,
    near: tuple[tuple[float, float], int], background: FloatArray,
) -> tuple[float, float]:  # fmt: skip
    """Cramer-Rao bounds of bias and offset, by the curvature of the echoes' power over the background at the peak."""
    fixed = track is None or not step
    if track is None or fixed:
        poses = [run["pose"].values] * 3
    else:
        poses = [poses_at(track, run["time"].values, offset + k * step) for k in (-1, 0, 1)]
    level, bias = _levels(run, poses, lines, near[0])
    wide = float(bias[2] - bias[0])
    k = int(np.clip(near[1], 2, bias.size - 3))
    # Near the peak the echoes' likelihood is the product's curvature times their power over the
    # background in all.
    power = (level[1, :, k] / background).sum() * np.log(10) / 10 * _score(level, background)
    curve = [
        2 * power[1, k] - power[1, k - 2] - power[1, k + 2],
        2 * power[1, k] - power[0, k] - power[2, k],
        0.0,
    ]
    curve[2] = (power[0, k + 2] + power[2, k - 2] - power[0, k - 2] - power[2, k + 2]) / 4
    if fixed:
        return (wide / np.sqrt(curve[0]) if curve[0] > 0 else np.inf), 0.0
    certain = curve[0] * curve[1] - curve[2] ** 2
    if certain <= 0 or curve[0] <= 0:
        return np.inf, np.inf
    return float(wide * np.sqrt(curve[1] / certain)), float(step * np.sqrt(curve[0] / certain))


def _at_reflectors(
    run: xr.Dataset,
    places: FloatArray,
    operator: Operator,
    bias: float,
    reach: float,
    passes: int = 3,
) -> pd.DataFrame:
    """Find each reflector's brightest pixel within ``reach``, and by how much it lies too far on average; m."""
    data, tx, rx = synthetic_aperture(run)
    weight = np.abs(data).sum(axis=(0, 2)) + np.finfo(float).tiny
    reach += resolution(run["frequency"].values)
    side = np.linspace(-reach, reach, 2 * int(np.ceil(reach / 0.02)) + 1)
    square = np.stack([*np.meshgrid(side, side), np.zeros((side.size, side.size))], axis=-1)
    rows: list[tuple[float, ...]] = []
    for _ in range(passes):
        rows = []
        moved = lengthen(data, run["frequency"].values, -2.0 * bias)
        for place in places:
            pixels = place + square
            image = operator(run["frequency"].values, tx, rx, pixels).adjoint(moved)
            power = (np.abs(image) ** 2).sum(axis=(0, 1))
            peak = pixels[np.unravel_index(power.argmax(), power.shape)]
            off = (
                float(np.average(_paths(tx, rx, peak) - _paths(tx, rx, place), weights=weight)) / 2
            )
            rows.append((*place, *peak[:2], bias + off))
        bias = float(np.mean([row[-1] for row in rows]))
    return pd.DataFrame(rows, columns=["x", "y", "z", "x_peak", "y_peak", "bias"])


def _paths(tx: FloatArray, rx: FloatArray, point: FloatArray) -> FloatArray:
    return np.asarray(
        np.linalg.norm(tx - point, axis=1) + np.linalg.norm(rx - point, axis=1), dtype=np.float64
    )
