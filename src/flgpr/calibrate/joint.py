"""Range bias and clock offset from reflectors at known positions, and how far to trust them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
import xarray as xr
from numpy.lib.stride_tricks import sliding_window_view

from flgpr.calibrate.clock import Operator, track_trials, with_track
from flgpr.calibrate.profiles import fields_over_bias, lattice, resolution
from flgpr.model import SPEED_OF_LIGHT, antennas_in_lane, check_run
from flgpr.model.aperture import synthetic_aperture
from flgpr.model.phase import lengthen
from flgpr.model.track import poses_at
from flgpr.types import ArrayLike, FloatArray, floats

STANDS_OUT = 4.0
"""Least height of a trusted peak over the best answer elsewhere, dB."""
_MOVES = 8  # to either side, by which reflectors are moved to see what chance can do
_COARSEST = 2.0  # resolution that such moves allow for, m
_SUMS_AT_ONCE = 4_000_000  # 96 MB with their powers
DEFAULT_SEARCH = 3.0
"""Largest range bias that is searched, m, where the unambiguous range allows it."""


@dataclass(frozen=True)
class BiasFit:
    """Range bias of a radar, the clock offset if it was searched too, and their quality."""

    bias: float  #: by how much one-way ranges are measured too long, m
    #: one standard deviation, m, from the echoes' height over the background and their spread
    bias_sigma: float
    #: time on the track's clock less the radar's, s; None if the run's poses were used
    offset: float | None
    offset_sigma: float | None  #: one standard deviation, s; 0 for a single offset tried
    #: height of the peak over the best answer two range resolutions away or more, dB
    over_runner_up: float
    over_median: float  #: height of the peak over the median, dB
    runner_up: float  #: bias of the best answer elsewhere, m
    over_moved: float  #: height of the peak over the best answer for reflectors moved sideways, dB
    spread: float  #: greatest less least bias of single reflectors, m; 0 for one alone
    searched: tuple[float, float]  #: least and greatest bias tried, m
    #: per reflector: its position x, y, z, its image's peak (x_peak, y_peak), and its bias, m
    points: pd.DataFrame
    doubt: str  #: why the answer is not to be trusted; empty if it is
    skipped: int = 0  #: offsets given that leave the track: they were not tried


def estimate_range_bias(
    run: xr.Dataset,
    points: ArrayLike,
    operator: Operator,
    search: float | None = None,
    tolerance: float = 0.15,
) -> BiasFit:
    """Estimate the range bias at the run's poses, as :func:`estimate_joint` does.

    Parameters
    ----------
    run, points, operator, tolerance
        As there.
    search : float, optional
        Largest bias to either side of zero, m; default 3 m, or half the unambiguous range if that
        is less.

    Returns
    -------
    BiasFit
        The bias, without a clock offset.
    """
    if search is None:
        search = min(DEFAULT_SEARCH, 0.49 * unambiguous_range(run["frequency"].values))
    return estimate_joint(run, points, operator, (-search, search), tolerance=tolerance)


def unambiguous_range(frequency: ArrayLike) -> float:
    """Return the one-way range after which the ranges of a run repeat, m."""
    return SPEED_OF_LIGHT / lattice(frequency)[0] / 2


def estimate_joint(
    run: xr.Dataset,
    points: ArrayLike,
    operator: Operator,
    biases: tuple[float, float],
    track: pd.DataFrame | None = None,
    offsets: ArrayLike = (),
    tolerance: float = 0.15,
    refine: int = 4,
) -> BiasFit:
    """Estimate the range bias, and the clock offset of a track, from reflectors at known positions.

    For every offset the scans are summed coherently at each reflector for all biases at once. The
    power there over its median is multiplied over the reflectors, and the product's peak is
    refined. An image around each reflector then shows a bias of its own: by how much its brightest
    pixel lies farther from the aperture than the reflector. What stands still in the run should be
    subtracted before: see :func:`flgpr.clutter.subtract_mean_scan`.

    Parameters
    ----------
    run : xarray.Dataset
        A run, with times if there is a track.
    points : (reflector, 3) array_like
        Positions of the reflectors in the lane frame, m, at least one.
    operator : callable
        ``flgpr.imaging.ImagingOperator``.
    biases : tuple of float
        Least and greatest bias, m; ranges must not repeat within them.
    track, offsets : DataFrame, (trial,) array_like
        Track of the array's reference point and evenly spaced clock offsets to try, s. Those that
        leave the track are skipped. Without a track the run's poses are used.
    tolerance : float
        How far from a reflector, across the line of sight, its echo may come from, and how far
        apart the biases of two reflectors may lie, m.
    refine : int
        How often the offsets' step is halved around the best.

    Returns
    -------
    BiasFit
        Bias and offset, with the reason in ``doubt`` if they are not to be trusted.

    Raises
    ------
    ValueError
        If the run has no complete scan, a parameter breaks its rule, or all offsets leave the
        track.
    """
    check_run(run)
    positions = floats(points)
    frequency = run["frequency"].values
    cell = resolution(frequency)
    _check_search(positions, biases, tolerance, cell, unambiguous_range(frequency))
    run = run.compute()
    if track is None:
        tried = np.zeros(1)
        poses = [run["pose"].values]
    else:
        tried, poses = track_trials(run, track, offsets)
    across, fine = _across(run, poses[len(poses) // 2], positions)
    # A quarter wavelength shows every lobe, whatever the aperture.
    line_step = SPEED_OF_LIGHT / float(frequency[-1]) / 4
    lines = positions[:, None] + _steps(tolerance, line_step) * across

    search = _Search(run, lines, biases)
    trials = search.trials(tried, poses)
    best = trials.best()
    offset = float(tried[best])
    curve = trials.score[best]
    at_best = search
    if track is not None:
        if trials.step:
            offset, curve = search.refined(track, trials, refine)
        at_best = replace(search, run=with_track(run, track, offset))

    peak = int(curve.argmax())
    height = float(curve[peak])
    bias = trials.bias
    over_bias = trials.score.max(axis=0)
    elsewhere = np.abs(bias - bias[peak]) > 2 * cell
    runner_up = int(np.where(elsewhere, over_bias, -np.inf).argmax())
    moved = _score_moved(at_best, positions, across, fine, tolerance, trials.background)

    bias_sigma = np.inf
    offset_sigma = np.inf
    if not trials.best_at_edge():
        noise = np.maximum(trials.level[..., elsewhere].mean(axis=(0, 2)), trials.background)
        middle = trials.inner(offset)
        bias_sigma, offset_sigma = at_best.sigma(track, middle, trials.step / 2, peak, noise)

    top = _summit(curve, bias, peak)
    table = _at_reflectors(at_best.run, positions, operator, top, tolerance)
    single = table["bias"].to_numpy()
    if single.size > 1:
        # The reflectors' disagreement counts too: errors of their positions are in it.
        standard_error = single.std(ddof=1) / np.sqrt(single.size)
        bias_sigma = float(np.hypot(bias_sigma, standard_error))

    fit = BiasFit(
        bias=float(single.mean()),
        bias_sigma=bias_sigma,
        offset=None if track is None else offset,
        offset_sigma=None if track is None else offset_sigma,
        over_runner_up=height - float(over_bias[runner_up]),
        over_median=height - float(np.median(over_bias)),
        runner_up=float(bias[runner_up]),
        over_moved=height - moved,
        spread=float(np.ptp(single)),
        searched=(float(biases[0]), float(biases[1])),
        points=table,
        doubt="",
        skipped=0 if track is None else floats(offsets).size - tried.size,
    )
    return replace(fit, doubt=_doubt(fit, trials.best_at_edge(), tolerance, cell))


@dataclass(frozen=True)
class _Trials:
    """Power and score at all clock offsets tried, for all biases."""

    offsets: FloatArray  #: (trial,): s
    bias: FloatArray  #: (bias,): m
    level: FloatArray  #: (trial, reflector, bias): power at the brightest point of each line
    background: FloatArray  #: (reflector,): median power over trials and biases
    score: FloatArray  #: (trial, bias): mean over reflectors of power over background, dB

    @property
    def step(self) -> float:
        """Step of the offsets, s; zero for a single one."""
        return float(np.diff(self.offsets).mean()) if self.offsets.size > 1 else 0.0

    def best(self) -> int:
        """Return the number of the trial with the highest score at any bias."""
        return int(self.score.max(axis=1).argmax())

    def best_at_edge(self) -> bool:
        """Return whether the best trial is the first or the last of several."""
        return self.step > 0 and self.best() in (0, self.offsets.size - 1)

    def inner(self, offset: float) -> float:
        """Return the nearest offset whose neighbours, half a step away, lie inside the track."""
        first = self.offsets[0] + self.step / 2
        last = self.offsets[-1] - self.step / 2
        return float(np.clip(offset, first, last))


@dataclass(frozen=True)
class _Search:
    """A run, and lines through its reflectors on which echoes are looked for at all biases."""

    run: xr.Dataset
    lines: FloatArray  #: (reflector, point, 3), m
    biases: tuple[float, float]  #: least and greatest, m

    def powers(self, poses: Sequence[ArrayLike]) -> tuple[FloatArray, FloatArray]:
        """Return the power of all polarizations (trial, reflector, point, bias), and the biases."""
        points = self.lines.reshape(-1, 3)
        field, bias = fields_over_bias(self.run, poses, points, self.biases)
        real = field.real.astype(np.float64)
        imaginary = field.imag.astype(np.float64)
        power = (real**2 + imaginary**2).sum(axis=1)
        return power.reshape(len(power), *self.lines.shape[:2], bias.size), bias

    def levels(self, poses: Sequence[ArrayLike]) -> tuple[FloatArray, FloatArray]:
        """Return the power (trial, reflector, bias) at a line's brightest point, and the biases."""
        cell = resolution(self.run["frequency"].values)
        # Biases are a quarter of the resolution apart or less, up to two times less.
        width = self.biases[1] - self.biases[0]
        sums = self.lines.shape[0] * self.lines.shape[1] * width / cell * 8
        trials_at_once = max(1, int(_SUMS_AT_ONCE / sums))
        levels = []
        bias = np.empty(0)
        for k in range(0, len(poses), trials_at_once):
            power, bias = self.powers(poses[k : k + trials_at_once])
            levels.append(power.max(axis=2))
        return np.concatenate(levels), bias

    def trials(self, offsets: FloatArray, poses: Sequence[ArrayLike]) -> _Trials:
        """Score all clock offsets, whose poses are given, for all biases."""
        level, bias = self.levels(poses)
        # The smallest positive number in place of zero: a run may be empty.
        background = np.maximum(np.median(level, axis=(0, 2)), np.finfo(np.float32).tiny)
        return _Trials(offsets, bias, level, background, _score(level, background))

    def refined(
        self, track: pd.DataFrame, trials: _Trials, rounds: int
    ) -> tuple[float, FloatArray]:
        """Halve the offsets' step about the best; return offset and score by bias."""
        best = trials.best()
        offset = float(trials.offsets[best])
        curve = trials.score[best]
        width = trials.step
        for _ in range(rounds):
            width /= 2
            around = [offset - width, offset, offset + width]
            closer, poses = track_trials(self.run, track, around)
            score = _score(self.levels(poses)[0], trials.background)
            best = int(score.max(axis=1).argmax())
            offset = float(closer[best])
            curve = score[best]
        return offset, curve

    def sigma(
        self,
        track: pd.DataFrame | None,
        offset: float,
        step: float,
        peak: int,
        background: FloatArray,
    ) -> tuple[float, float]:
        """Return the Cramer-Rao bounds (standard deviations) of bias, m, and offset, s.

        They follow from the curvature of the echoes' power over the background at the ``peak``, the
        number of a bias. The matrix of the second derivatives in bias and offset is the Fisher
        information; the diagonal of its inverse holds the variances.
        """
        fixed = track is None or not step
        if track is None or fixed:
            poses = [self.run["pose"].values] * 3
        else:
            poses = [
                poses_at(track, self.run["time"].values, offset + k * step) for k in (-1, 0, 1)
            ]
        level, bias = self.levels(poses)
        width = float(bias[2] - bias[0])
        k = int(np.clip(peak, 2, bias.size - 3))
        # Near the peak the echoes' likelihood is the product's curvature times their power over the
        # background in all.
        power = (level[1, :, k] / background).sum() * np.log(10) / 10 * _score(level, background)
        by_bias = 2 * power[1, k] - power[1, k - 2] - power[1, k + 2]
        by_offset = 2 * power[1, k] - power[0, k] - power[2, k]
        mixed = (power[0, k + 2] + power[2, k - 2] - power[0, k - 2] - power[2, k + 2]) / 4
        if fixed:
            return (width / np.sqrt(by_bias) if by_bias > 0 else np.inf), 0.0
        determinant = by_bias * by_offset - mixed**2
        if determinant <= 0 or by_bias <= 0:
            return np.inf, np.inf
        bias_sigma = float(width * np.sqrt(by_offset / determinant))
        offset_sigma = float(step * np.sqrt(by_bias / determinant))
        return bias_sigma, offset_sigma


def _check_search(
    positions: FloatArray, biases: tuple[float, float], tolerance: float, cell: float, most: float
) -> None:
    """Refuse an impossible search; resolution ``cell`` and unambiguous range ``most`` in m."""
    is_list = positions.ndim == 2 and positions.shape[1:] == (3,) and len(positions) > 0
    if not is_list or not np.isfinite(positions).all():
        raise ValueError(
            "points must be finite with the shape (reflector, 3) and at least one, "
            f"got {positions.shape}"
        )
    low, high = biases
    if not (np.isfinite(biases).all() and 8 * cell <= high - low <= most):
        raise ValueError(
            f"biases must span from {8 * cell:.2g} m, eight times the range resolution, "
            f"to {most:.3g} m, after which the ranges of this run repeat; "
            f"got {low:g} to {high:g} m"
        )
    if not 0 < tolerance <= _COARSEST:
        raise ValueError(
            f"tolerance must be positive and at most {_COARSEST:g} m, got {tolerance:g}"
        )


def _doubt(fit: BiasFit, at_edge: bool, tolerance: float, cell: float) -> str:
    """Return the reason not to trust an answer; empty if there is none."""
    low, high = fit.searched
    if at_edge:
        return (
            f"the best clock offset, {fit.offset:.3f} s, lies at the edge of those tried: "
            "look farther"
        )
    if not low + cell < fit.bias < high - cell:
        return (
            f"the best bias, {fit.bias:.2f} m, lies at the edge of {low:g} to {high:g} m: "
            "look farther"
        )
    if fit.over_runner_up < STANDS_OUT:
        return (
            f"no bias stands out from {low:g} to {high:g} m: {fit.bias:.2f} m is but "
            f"{fit.over_runner_up:.1f} dB better than {fit.runner_up:.2f} m, "
            f"{STANDS_OUT:g} dB are asked for"
        )
    if fit.over_moved < STANDS_OUT:
        return (
            f"{fit.bias:.2f} m is but {fit.over_moved:.1f} dB better than the best answer for "
            f"reflectors moved sideways, {STANDS_OUT:g} dB are asked for: are their places right, "
            "and nothing about as bright near them?"
        )
    if fit.spread > tolerance:
        listed = ", ".join(f"{bias:.2f}" for bias in fit.points["bias"])
        return f"the reflectors disagree: they tell {listed} m, more than {tolerance:g} m apart"
    if not np.isfinite([fit.bias_sigma, fit.offset_sigma or 0.0]).all():
        return (
            "the echoes do not tell clock offset and bias apart: "
            "they are as good at others along a line of them"
        )
    return ""


def _across(run: xr.Dataset, pose: FloatArray, positions: FloatArray) -> tuple[FloatArray, float]:
    """Return level unit vectors (reflector, 1, 3) across the line of sight, and a resolution.

    It is the coarsest of the reflectors' resolutions along these vectors, m.
    """
    tx, rx = antennas_in_lane(run, pose)
    sight = positions - 0.5 * (tx.mean(axis=0) + rx.mean(axis=0))
    across = np.stack([sight[:, 1], -sight[:, 0], np.zeros(len(positions))], axis=1)
    size = np.linalg.norm(across, axis=1, keepdims=True)
    safe_size = np.where(size > 0, size, 1.0)
    across = np.where(size > 0, across / safe_size, [1.0, 0.0, 0.0])

    # The path to a point moved across changes by this slope, which differs along the aperture: the
    # resolution is the wavelength over its range.
    spreads = []
    for position, direction in zip(positions, across, strict=True):
        # 0 + a + b, as a sum over the two ends.
        slope = 0
        for end in (tx, rx):
            line = end - position
            slope = slope + line @ direction / np.linalg.norm(line, axis=1)
        spreads.append(np.ptp(slope))
    wavelength = SPEED_OF_LIGHT / float(run["frequency"].values.mean())
    return across[:, None], float(min(wavelength / max(min(spreads), 1e-9), _COARSEST))


def _steps(reach: float, step: float) -> FloatArray:
    """Return even steps (step, 1) of at most ``step`` from -``reach`` to ``reach`` through zero."""
    half = int(np.ceil(reach / step))
    return np.linspace(-reach, reach, 2 * half + 1)[:, None]


def _score_moved(
    search: _Search,
    positions: FloatArray,
    across: FloatArray,
    fine: float,
    tolerance: float,
    background: FloatArray,
) -> float:
    """Return the best score of reflectors all moved sideways, which is what chance can do.

    They are moved so far that their own echoes do not count.
    """
    clear = 2 * tolerance + 1.5 * fine
    reach = clear + _MOVES * max(2 * tolerance, fine)
    steps = _steps(reach, min(fine / 4, tolerance))
    lines = positions[:, None] + steps * across
    power, _ = replace(search, lines=lines).powers([search.run["pose"].values])

    # Like a reflector's, an echo may come from anywhere within the tolerance.
    half = round(tolerance / float(steps[1, 0] - steps[0, 0]))
    level = sliding_window_view(power[0], 2 * half + 1, axis=1).max(axis=-1)
    is_clear = np.abs(steps[half : steps.size - half, 0]) > clear
    moved_level = level[:, is_clear].swapaxes(0, 1)
    return float(_score(moved_level, background).max())


def _score(level: FloatArray, background: FloatArray) -> FloatArray:
    """Return the mean over reflectors of the power over the background, dB: (trial, bias)."""
    floor = np.finfo(np.float32).tiny
    ratio = np.maximum(level / background[:, None], floor)
    return 10 * np.log10(ratio).mean(axis=1)


def _summit(curve: FloatArray, bias: FloatArray, peak: int) -> float:
    """Return the bias at the top of the parabola through a peak and its neighbours.

    The answer is then finer than the grid of the biases.
    """
    if not 0 < peak < bias.size - 1:
        return float(bias[peak])
    left, top, right = curve[peak - 1 : peak + 2]
    bend = left - 2 * top + right
    if not bend < 0:
        return float(bias[peak])
    return float(bias[peak] + (bias[1] - bias[0]) * (left - right) / (2 * bend))


def _at_reflectors(
    run: xr.Dataset,
    positions: FloatArray,
    operator: Operator,
    bias: float,
    reach: float,
    passes: int = 3,
) -> pd.DataFrame:
    """Return each reflector's brightest pixel within ``reach``, and the bias that it shows, m."""
    data, tx, rx = synthetic_aperture(run)
    frequency = run["frequency"].values
    weight = np.abs(data).sum(axis=(0, 2)) + np.finfo(float).tiny
    reach += resolution(frequency)
    side = np.linspace(-reach, reach, 2 * int(np.ceil(reach / 0.02)) + 1)
    square = np.stack([*np.meshgrid(side, side), np.zeros((side.size, side.size))], axis=-1)
    rows: list[tuple[float, ...]] = []
    # Repeated with the bias found: where it was wrong, the image was not quite in focus.
    for _ in range(passes):
        rows = []
        corrected = lengthen(data, frequency, -2.0 * bias)
        for position in positions:
            pixels = position + square
            image = operator(frequency, tx, rx, pixels).adjoint(corrected)
            power = (np.abs(image) ** 2).sum(axis=(0, 1))
            peak = pixels[np.unravel_index(power.argmax(), power.shape)]
            longer = _paths(tx, rx, peak) - _paths(tx, rx, position)
            too_far = float(np.average(longer, weights=weight)) / 2
            rows.append((*position, *peak[:2], bias + too_far))
        bias = float(np.mean([row[-1] for row in rows]))
    return pd.DataFrame(rows, columns=["x", "y", "z", "x_peak", "y_peak", "bias"])


def _paths(tx: FloatArray, rx: FloatArray, point: FloatArray) -> FloatArray:
    """Return the path lengths of antennas (pair, 3) by way of a point, m."""
    outward = np.linalg.norm(tx - point, axis=1)
    back = np.linalg.norm(rx - point, axis=1)
    return floats(outward + back)
