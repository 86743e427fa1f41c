"""Range bias, and with it the clock offset, from reflectors at known places, and how far the answer can be trusted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import ArrayLike

from flgpr.calibrate.clock import Operator, synthetic_aperture, track_trials, with_track
from flgpr.calibrate.profiles import fields_over_bias, lattice, resolution, way_weights
from flgpr.model import SPEED_OF_LIGHT, check_run
from flgpr.model.arrays import FloatArray
from flgpr.model.phase import lengthen
from flgpr.model.track import poses_at

STANDS_OUT = 3.0
"""Least height of a trusted peak over the best answer elsewhere, dB."""
DEFAULT_SEARCH = 3.0
"""How far to either side of zero a range bias is looked for, m, where the unambiguous range allows it."""


@dataclass(frozen=True)
class BiasFit:
    """Range bias of a radar, with the clock offset where that was looked for as well, and how good they are."""

    bias: float  #: by how much one-way ranges are measured too long, m
    bias_sigma: float  #: one standard deviation, m, from the echoes' height over the background and their spread
    offset: float | None  #: time on the track's clock less the radar's, s; None where the run's poses were taken
    offset_sigma: float | None  #: one standard deviation, s; infinite where the echoes do not tell
    #: height of the peak over the best answer elsewhere, two range resolutions away or more, and over the median, dB
    over_runner_up: float
    over_median: float
    runner_up: float  #: bias of the best answer elsewhere, m
    spread: float  #: greatest less least bias that single reflectors tell, m; 0 for one alone
    searched: tuple[float, float]  #: least and greatest bias tried, m
    #: per reflector: its place x, y, z, where its image peaks (x_peak, y_peak), and the bias it tells, m
    points: pd.DataFrame
    doubt: str  #: why the answer is not to be trusted; empty if it is


def estimate_range_bias(
    run: xr.Dataset, points: ArrayLike, operator: Operator, search: float | None = None, tolerance: float = 0.15
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

    For every offset the scans are summed coherently at each reflector for all biases at once. The power there over its
    median is multiplied over the reflectors, and the product's peak is refined. An image around each reflector then
    tells a bias of its own: by how much its brightest pixel lies farther from the aperture than the reflector. What
    stands still in the run should be out of it: see :func:`flgpr.calibrate.remove_standing`.

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
        Track of the array's reference point and evenly spaced clock offsets to try, s. Those that leave the track are
        passed over; if all do, it is a ValueError. Without a track the run's poses are taken as they are.
    tolerance : float
        How far from a reflector's place, across the line of sight, its echo may come from, and how far apart the
        biases of two reflectors may lie, m.
    refine : int
        How often the offsets' step is halved around the best.
    """
    check_run(run)
    places = np.asarray(points, dtype=np.float64)
    if places.ndim != 2 or places.shape[1:] != (3,) or not len(places):
        raise ValueError(f"points must have the shape (reflector, 3) with at least one, got {places.shape}")
    if not (np.isfinite(biases).all() and biases[0] < biases[1]):
        raise ValueError(f"biases must be finite and increase, got {biases[0]:g} and {biases[1]:g} m")
    most = unambiguous_range(run["frequency"].values)
    if biases[1] - biases[0] > most:
        raise ValueError(
            f"biases must span at most {most:.3g} m, after which the ranges of this run repeat, got {biases[0]:g} to "
            f"{biases[1]:g} m"
        )
    if not (tolerance > 0 and np.isfinite(tolerance)):
        raise ValueError(f"tolerance must be positive, got {tolerance:g}")
    run = run.compute()
    when, poses = (np.zeros(1), [run["pose"].values]) if track is None else track_trials(run, track, offsets)
    lines = _lines(run, poses[len(poses) // 2], places, tolerance)
    level, bias = _levels(run, poses, lines, biases)
    background = np.maximum(np.median(level, axis=(0, 2)), np.finfo(np.float32).tiny)
    score = _score(level, background)
    at, step = int(score.max(axis=1).argmax()), float(np.diff(when).mean()) if when.size > 1 else 0.0
    edge = step > 0 and at in (0, when.size - 1)
    best, first = float(when[at]), (float(score[at].max()), int(score[at].argmax()))
    width = step
    for _ in range(refine if step else 0):
        width /= 2
        around, poses = track_trials(run, track, [best - width, best, best + width])
        fine = _score(_levels(run, poses, lines, biases)[0], background)
        at = int(fine.max(axis=1).argmax())
        best, first = float(around[at]), (float(fine[at].max()), int(fine[at].argmax()))
    height, peak = first
    elsewhere = np.abs(bias - bias[peak]) > 2 * resolution(run["frequency"].values)
    over_bias = score.max(axis=0)
    rival = int(np.where(elsewhere, over_bias, -np.inf).argmax())
    sigma = _sigma(run, track, best, step / 2, lines, (biases, peak), background)
    found = run if track is None else with_track(run, track, best)
    table = _at_reflectors(found, places, operator, float(bias[peak]), tolerance)
    single = table["bias"].to_numpy()
    mean, spread = float(single.mean()), float(np.ptp(single))
    if single.size > 1:
        sigma = float(np.hypot(sigma[0], single.std(ddof=1) / np.sqrt(single.size))), sigma[1]
    fit = BiasFit(
        mean, sigma[0], None if track is None else best, None if track is None else sigma[1],
        height - float(over_bias[rival]) if elsewhere.any() else np.inf, height - float(np.median(over_bias)),
        float(bias[rival]), spread, (float(biases[0]), float(biases[1])), table, "",
    )  # fmt: skip
    return replace(fit, doubt=_doubt(fit, edge, tolerance, resolution(run["frequency"].values)))


def _doubt(fit: BiasFit, edge: bool, tolerance: float, cell: float) -> str:
    """Say what speaks against an answer; nothing if all is well."""
    low, high = fit.searched
    if edge:
        return f"the best clock offset, {fit.offset:.3f} s, lies at the edge of those tried: look farther"
    if not low + cell < fit.bias < high - cell:
        return f"the best bias, {fit.bias:.2f} m, lies at the edge of {low:g} to {high:g} m: look farther"
    if fit.over_runner_up < STANDS_OUT:
        return (
            f"no bias stands out from {low:g} to {high:g} m: {fit.bias:.2f} m is but {fit.over_runner_up:.1f} dB better "
            f"than {fit.runner_up:.2f} m, {STANDS_OUT:g} dB are asked for"
        )
    if fit.spread > tolerance:
        told = ", ".join(f"{one:.2f}" for one in fit.points["bias"])
        return f"the reflectors disagree: they tell {told} m, more than {tolerance:g} m apart"
    if fit.offset_sigma is not None and not np.isfinite(fit.offset_sigma):
        return "the echoes do not tell the clock offset: they are as good at other ones"
    return ""


def _lines(run: xr.Dataset, pose: FloatArray, places: FloatArray, tolerance: float) -> FloatArray:
    """Points (reflector, point, 3) across the line of sight of every reflector, a quarter wavelength apart at most."""
    seen = places - np.average(pose[:, :3], axis=0, weights=way_weights(pose[:, :3]))
    across = np.stack([seen[:, 1], -seen[:, 0], np.zeros(len(places))], axis=1)
    size = np.linalg.norm(across, axis=1, keepdims=True)
    across = np.where(size > 0, across / np.where(size > 0, size, 1.0), [1.0, 0.0, 0.0])
    half = int(np.ceil(tolerance / (SPEED_OF_LIGHT / float(run["frequency"].values[-1]) / 4)))
    return np.asarray(places[:, None] + np.linspace(-tolerance, tolerance, 2 * half + 1)[:, None] * across[:, None])


def _levels(
    run: xr.Dataset, poses: Sequence[ArrayLike], lines: FloatArray, biases: tuple[float, float]
) -> tuple[FloatArray, FloatArray]:
    """Power (trial, reflector, bias) at the brightest point of each reflector's line, and the biases."""
    field, bias = fields_over_bias(run, poses, lines.reshape(-1, 3), biases)
    power = (field.real.astype(np.float64) ** 2 + field.imag.astype(np.float64) ** 2).sum(axis=1)
    return power.reshape(len(power), *lines.shape[:2], bias.size).max(axis=2), bias


def _score(level: FloatArray, background: FloatArray) -> FloatArray:
    """Mean over reflectors of the power over the background, dB: (trial, bias)."""
    floor = np.finfo(np.float32).tiny
    return np.asarray(10 * np.log10(np.maximum(level / background[:, None], floor)).mean(axis=1))


def _sigma(
    run: xr.Dataset, track: pd.DataFrame | None, offset: float, step: float, lines: FloatArray,
    near: tuple[tuple[float, float], int], background: FloatArray,
) -> tuple[float, float]:  # fmt: skip
    """Cramer-Rao bounds of bias and offset, by the curvature of the echoes' power over the background at the peak."""
    if track is None:
        poses, step = [run["pose"].values] * 3, 1.0
    else:
        poses = [poses_at(track, run["time"].values, offset + k * step) for k in (-1, 0, 1)]
    level, bias = _levels(run, poses, lines, near[0])
    # The median of a complex Gaussian background's power is ln 2 times its mean.
    power = (level / background[:, None]).sum(axis=1) * np.log(2)
    wide, k = float(bias[2] - bias[0]), int(np.clip(near[1], 2, bias.size - 3))
    curve = [2 * power[1, k] - power[1, k - 2] - power[1, k + 2], 2 * power[1, k] - power[0, k] - power[2, k], 0.0]
    curve[2] = (power[0, k + 2] + power[2, k - 2] - power[0, k - 2] - power[2, k + 2]) / 4
    if track is None:
        return (wide / np.sqrt(curve[0]) if curve[0] > 0 else np.inf), 0.0
    certain = curve[0] * curve[1] - curve[2] ** 2
    if certain <= 0 or curve[0] <= 0:
        return np.inf, np.inf
    return float(wide * np.sqrt(curve[1] / certain)), float(step * np.sqrt(curve[0] / certain))


def _at_reflectors(
    run: xr.Dataset, places: FloatArray, operator: Operator, bias: float, reach: float, passes: int = 3
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
            off = float(np.average(_paths(tx, rx, peak) - _paths(tx, rx, place), weights=weight)) / 2
            rows.append((*place, *peak[:2], bias + off))
        bias = float(np.mean([row[-1] for row in rows]))
    return pd.DataFrame(rows, columns=["x", "y", "z", "x_peak", "y_peak", "bias"])


def _paths(tx: FloatArray, rx: FloatArray, point: FloatArray) -> FloatArray:
    return np.asarray(np.linalg.norm(tx - point, axis=1) + np.linalg.norm(rx - point, axis=1), dtype=np.float64)
