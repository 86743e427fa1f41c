"""``flgpr calibrate``: calibrate a run against positions and reflectors."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from typer import Option

from flgpr.commands.options import ANCHOR, OUTPUT, Limits, PathLike, Progress, RunArgument
from flgpr.commands.shell import Arguments, command, written

if TYPE_CHECKING:
    from flgpr.calibrate import BiasFit, ClockFit, GroundFit, PoseFit
    from flgpr.types import Entries

NewRun = Annotated[PathLike | None, OUTPUT.option("calibrated run store")]
Reflectors = Annotated[PathLike, Option(help="CSV of reflectors: x_m, y_m, z_m in the lane frame.")]
Tolerance = Annotated[
    float,
    "Largest distance of an echo from its reflector, and largest difference between "
    "reflectors' biases, m.",
]
Offsets = Annotated[Limits, Option(help="Least and greatest offset of the track's clock, s.")]
TrackFile = Annotated[
    PathLike | None, Option("--track", help="CSV track or NMEA log; NAME-track.csv by default.")
]
TrackAnchor = Annotated[PathLike | None, ANCHOR.option("to read an NMEA log")]
Step = Annotated[float, "First step of the offsets, s; halved four times around the best."]
KeepStanding = Annotated[
    bool,
    "Search with what is the same in all scans; it is removed by default.",
]


def _clock_lines(fit: ClockFit, call: Arguments) -> Iterator[Any]:
    """Yield offset and rate, how far they stand out, and the store."""
    best = float(fit.trials["sharpness"].max())
    yield f"clock offset {fit.offset:.4f} s, rate {fit.rate:g}, from {len(fit.trials)} trials"
    yield f"sharpness there is {best / fit.lowest:.2f} times the least of the trial offsets"
    if fit.rate_at_edge:
        yield f"rate {fit.rate:g} lies at the edge of those tried: a better one may lie beyond"
    yield from _last_lines(fit, call)


def _clock_json(fit: ClockFit, call: Arguments) -> Entries:
    """Return the figures of a clock."""
    return {
        "clock_offset_s": fit.offset,
        "clock_rate": fit.rate,
        "sharpness": float(fit.trials["sharpness"].max()),
        "least_sharpness": fit.lowest,
        "clock_rate_at_edge": fit.rate_at_edge,
        "trials": len(fit.trials),
        "offsets_not_tried": fit.skipped,
        "standing_part_removed": not call.keep_standing,
    }


def _bias_lines(fit: BiasFit, call: Arguments) -> Iterator[Any]:
    """Yield the bias, how far it stands out, each reflector, and the store."""
    if fit.offset is not None:
        yield f"clock offset {fit.offset:.4f} s, one standard deviation {fit.offset_sigma:.4f} s"
    low, high = fit.searched
    yield (
        f"range bias {fit.bias:.4f} m, one standard deviation {fit.bias_sigma:.4f} m, "
        f"searched from {low:g} to {high:g} m"
    )
    yield (
        f"the peak stands {fit.over_runner_up:.1f} dB over the next best bias "
        f"({fit.runner_up:.2f} m), {fit.over_moved:.1f} dB over reflectors moved sideways, "
        f"{fit.over_median:.1f} dB over the median"
    )
    for row in fit.points.to_dict("records"):
        yield (
            f"reflector at ({row['x']:.3f}, {row['y']:.3f}) m: its echo peaks at "
            f"({row['x_peak']:.3f}, {row['y_peak']:.3f}) m, which is a bias of {row['bias']:.4f} m"
        )
    if len(fit.points) == 1:
        yield "a single reflector does not show an error of its position along the line of sight"
    yield from _last_lines(fit, call)


def _bias_json(fit: BiasFit, call: Arguments) -> Entries:
    """Return the figures of a bias, with those of the clock if it was estimated."""
    figures: Entries = {}
    if fit.offset is not None:
        figures |= {
            "clock_offset_s": fit.offset,
            "clock_offset_sigma_s": fit.offset_sigma,
            "offsets_not_tried": fit.skipped,
        }
    return figures | {
        "range_bias_m": fit.bias,
        "range_bias_sigma_m": fit.bias_sigma,
        "over_runner_up_db": fit.over_runner_up,
        "runner_up_m": fit.runner_up,
        "over_moved_db": fit.over_moved,
        "over_median_db": fit.over_median,
        "spread_m": fit.spread,
        "searched_m": fit.searched,
        "standing_part_removed": not call.keep_standing,
        "reflectors": fit.points.to_dict("records"),
    }


def _last_lines(fit: ClockFit | BiasFit, call: Arguments) -> Iterator[Any]:
    """Yield whether the search was with what is the same in all scans, and the store."""
    outcome = "kept" if call.keep_standing else "left out of the search"
    yield f"what stands still in the scans (coupling, the vehicle's own echoes) was {outcome}"
    if fit.skipped:
        yield f"{fit.skipped} offsets were not tried: they put scans outside the track"
    yield from written(fit, call)


@command(lines=_clock_lines, as_json=_clock_json, quiet=False)
def calibrate_clock(
    run: RunArgument,
    area: Annotated[tuple[float, float, float, float], Option()],
    offsets: Offsets,
    output: NewRun = None,
    track: TrackFile = None,
    anchor: TrackAnchor = None,
    step: Step = 0.05,
    height: float = 0.0,
    spacing: float | None = None,
    rate: Sequence[float] | None = None,
    keep_standing: KeepStanding = False,
) -> ClockFit:
    """Find the offset between the radar's clock and the track's by focus alone, without reflectors.

    Ranges must be right to about their resolution: where they may be biased and reflectors are
    known, take joint. An answer at the edge of the offsets, or one that does not stand out, is
    refused.

    Parameters
    ----------
    height
        z of the area, m.
    spacing
        Pixel spacing, m; a quarter wavelength by default.
    rate
        Clock rate to try; may repeat, 1 by default.
    area
        Ground to focus: x and y limits, m.

    Returns
    -------
    ClockFit
        Offset (s), rate, and the sharpness of every trial. What is the same in all scans is left
        out of the search only; it is in the run that is stored.

    Raises
    ------
    ValueError
        If the answer cannot be trusted; the message says why.
    """
    from flgpr.calibrate import estimate_clock
    from flgpr.calibrate.trial_grid import offsets_to_try, pixels_of_area
    from flgpr.commands.calibration import Calibration
    from flgpr.imaging import ImagingOperator

    calibration = Calibration(run, keep_standing)
    track_table = calibration.track(track, anchor)
    fit = estimate_clock(
        calibration.searched,
        track_table,
        pixels_of_area(calibration.run["frequency"].values, area, height, spacing),
        offsets_to_try(offsets, step),
        ImagingOperator,
        tuple(rate or [1.0]),
    )
    calibration.finish(fit, output, track_table)
    return fit


@command(lines=_bias_lines, as_json=_bias_json, quiet=False)
def calibrate_range_bias(
    run: RunArgument,
    reflectors: Reflectors,
    output: NewRun = None,
    search: float | None = None,
    tolerance: Tolerance = 0.15,
    keep_standing: KeepStanding = False,
) -> BiasFit:
    """Find by how much ranges are measured too long, from reflectors at known positions.

    The clock must be right. An answer that does not stand out, lies at the edge of the search, or
    on which reflectors disagree is refused.

    Parameters
    ----------
    search
        Largest bias to either side of zero, m; 3, or what unambiguous ranges allow.

    Returns
    -------
    BiasFit
        The bias (m) with its standard deviation, and how far it stands out.

    Raises
    ------
    ValueError
        If the answer cannot be trusted; the message says why.
    """
    from flgpr.calibrate import estimate_range_bias
    from flgpr.commands.calibration import Calibration, read_reflectors
    from flgpr.imaging import ImagingOperator

    calibration = Calibration(run, keep_standing)
    positions = read_reflectors(reflectors)
    if search is not None and not search > 0:
        raise ValueError(f"search must be positive, got {search:g}")
    fit = estimate_range_bias(calibration.searched, positions, ImagingOperator, search, tolerance)
    calibration.finish(fit, output)
    return fit


@command(lines=_bias_lines, as_json=_bias_json, quiet=False)
def calibrate_joint(
    run: RunArgument,
    reflectors: Reflectors,
    offsets: Offsets,
    biases: Limits = (
        -3.0,
        3.0,
    ),
    output: NewRun = None,
    track: TrackFile = None,
    anchor: TrackAnchor = None,
    step: Step = 0.05,
    tolerance: Tolerance = 0.15,
    keep_standing: KeepStanding = False,
) -> BiasFit:
    """Find clock offset and range bias together, from reflectors at known positions.

    An answer that does not stand out, lies at the edge of the search, or on which reflectors
    disagree is refused.

    Parameters
    ----------
    biases
        Least and greatest range bias, m.

    Returns
    -------
    BiasFit
        Offset (s) and bias (m) with their standard deviations, and how far they stand out.

    Raises
    ------
    ValueError
        If the answer cannot be trusted; the message says why.
    """
    from flgpr.calibrate import estimate_joint
    from flgpr.calibrate.trial_grid import offsets_to_try
    from flgpr.commands.calibration import Calibration, read_reflectors
    from flgpr.imaging import ImagingOperator

    calibration = Calibration(run, keep_standing)
    positions = read_reflectors(reflectors)
    track_table = calibration.track(track, anchor)
    fit = estimate_joint(
        calibration.searched,
        positions,
        ImagingOperator,
        biases,
        track_table,
        offsets_to_try(offsets, step),
        tolerance,
    )
    calibration.finish(fit, output, track_table)
    return fit


_FEW_SCANS = 20  # whose mean holds so much of their ground that poses are told worse


def _pose_lines(fit: PoseFit, call: Arguments) -> Iterator[Any]:
    """Yield how wrong the poses were, what that costs, how well they are known, and the store."""
    yield (
        f"along the line of sight a scan's pose was off by {1e3 * fit.before:.1f} mm against its "
        f"neighbours', now by {1e3 * fit.after:.1f} mm (standard deviations)"
    )
    low, high = fit.band
    loss_before, loss = _losses(fit)
    yield (
        f"so a sum over many scans from {low / 1e9:.3g} to {high / 1e9:.3g} GHz loses {loss:.1f} dB in "
        f"place of {loss_before:.1f} dB"
    )
    yield f"{fit.alike} of {fit.pairs} pairs of scans see the ground alike"
    if len(fit.pose) < _FEW_SCANS and not call.keep_standing:
        yield (
            f"the mean of {len(fit.pose)} scans was left out of the search and holds a part of their "
            "ground, which adds millimetres: where nothing stands still, --keep-standing"
        )
    if fit.alone:
        yield f"{fit.alone} scans are in none of these: only the navigation tells their poses"
    across, along, up = 1e3 * fit.deviation
    yield (
        f"positions are known to {across:.0f} mm across, {along:.0f} mm along and {up:.0f} mm up, with "
        f"errors of the navigation of {1e3 * fit.position:.0f} mm assumed; what all scans have in common "
        "is the navigation's, heading, pitch and roll stay as they were"
    )
    yield from written(fit, call)
    if call.output is not None:
        yield table_of_poses(call.output)


def table_of_poses(store: PathLike) -> Path:
    """Return the file that tells by how much each pose of a new run was moved."""
    return Path(store).with_name(f"{Path(store).stem}-poses.csv")


def _losses(fit: PoseFit) -> tuple[float, float]:
    """Return what a sum over many scans loses by the errors before and now, dB."""
    import numpy as np

    from flgpr.clutter import coherent_loss_db

    before, now = coherent_loss_db([fit.before, fit.after], np.linspace(*fit.band)).tolist()
    return before, now


def _pose_json(fit: PoseFit, call: Arguments) -> Entries:
    """Return the figures of poses."""
    loss_before, loss = _losses(fit)
    return {
        "before_m": fit.before,
        "after_m": fit.after,
        "band_hz": fit.band,
        "loss_before_db": loss_before,
        "loss_db": loss,
        "pairs": fit.pairs,
        "pairs_alike": fit.alike,
        "scans": len(fit.pose),
        "scans_alone": fit.alone,
        "position_assumed_m": fit.position,
        "position_sigma_m": fit.deviation.tolist(),
        "height_m": fit.height,
        "standing_part_removed": not call.keep_standing,
    }


@command(lines=_pose_lines, as_json=_pose_json, quiet=False)
def calibrate_poses(
    run: RunArgument,
    output: NewRun = None,
    position: float | None = None,
    keep_standing: KeepStanding = False,
    *,
    track: Progress = None,
) -> PoseFit:
    """Find the errors of the poses from scan to scan, by the ground that several scans see.

    For arrays that look ahead. What all scans have in common, or grows slowly along the road, stays
    as the navigation has it. An answer that the ground does not support is refused.

    Parameters
    ----------
    position
        Standard deviation of the navigation's errors of each coordinate, m; 0.03, or the most that
        leaves phases unambiguous.

    Returns
    -------
    PoseFit
        The poses, and how well they are known. Beside the new run NAME-poses.csv tells by how much
        each was moved.

    Raises
    ------
    ValueError
        If the answer cannot be trusted; the message says why.
    """
    from flgpr.calibrate import focus_poses
    from flgpr.commands.calibration import Calibration
    from flgpr.imaging import ImagingOperator
    from flgpr.progress import silent
    from flgpr.store import write_table

    calibration = Calibration(run, keep_standing)
    fit = focus_poses(calibration.searched, ImagingOperator, position, track or silent)
    calibration.finish(fit, output)
    if output is not None:
        write_table(fit.table().round(6), table_of_poses(output))
    return fit


_BEYOND = ", the edge of the delays: do these hold the top of a hyperbola?"


def _permittivity_lines(fit: GroundFit, _: Arguments) -> Iterator[str]:
    """Yield the permittivity and how far it stands out."""
    yield f"permittivity {fit.permittivity:.2f}: {_speed(fit):.4f} m/ns"
    yield f"sharpness there is {fit.contrast:.2f} times the median of all trials"
    yield f"what focuses best lies at {fit.place:.2f} m, {1e9 * fit.delay:.3g} ns{fit.doubt}"


def _permittivity_json(fit: GroundFit, _: Arguments) -> dict[str, float]:
    """Return the figures of a ground."""
    return {
        "permittivity": fit.permittivity,
        "speed_m_per_ns": _speed(fit),
        "sharpness_over_median": fit.contrast,
        "place_m": fit.place,
        "delay_ns": 1e9 * fit.delay,
        "at_edge": bool(fit.doubt),
    }


def _speed(fit: GroundFit) -> float:
    """Return the speed of waves in the ground, m/ns."""
    return float(0.299792458 / fit.permittivity**0.5)


@command(lines=_permittivity_lines, as_json=_permittivity_json, always_printed=True)
def calibrate_permittivity(
    run: RunArgument,
    along: Limits | None = None,
    delays: Limits = (1.0, 30.0),
    limits: Limits = (2.0, 36.0),
    *,
    trials: int = 41,
    track: Progress = None,
) -> GroundFit:
    """Find the ground's permittivity by the focus of hyperbolas, for ground-coupled antennas.

    Parameters
    ----------
    along
        Stretch of the line that holds hyperbolas, m; all by default.
    delays
        Delays that hold them, ns.
    limits
        Least and greatest permittivity to try.
    trials
        Number of permittivities that are tried.

    Returns
    -------
    GroundFit
        The permittivity, how far its sharpness stands out, and all trials.

    Raises
    ------
    ValueError
        If no permittivity stands out, or the best lies at the edge of the limits.
    """
    from flgpr.calibrate.permittivity import estimate_permittivity
    from flgpr.imaging.section import LineSection
    from flgpr.progress import silent
    from flgpr.store import open_run

    low, high = limits
    if not 1 <= low < high < math.inf:
        raise ValueError(f"limits must increase from 1 or more, got {low:g}, {high:g}")
    # In equal ratios: it is the relative change of the speed that defocuses.
    values = [low * (high / low) ** (k / max(trials - 1, 1)) for k in range(trials)]
    section = LineSection(open_run(run), along, (delays[0] * 1e-9, delays[1] * 1e-9))
    fit = estimate_permittivity(section.image, values, track or silent)
    place, delay, is_edge = section.focus(fit.permittivity)
    return replace(fit, place=place, delay=delay, doubt=_BEYOND if is_edge else "")
