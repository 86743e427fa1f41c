"""Commands that calibrate runs against positions, and tie lanes to the Earth."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer
from typer import Argument, Option

from flgpr import tasks
from flgpr.cli.common import Json, plain_errors, tell_written

calibrate_app = typer.Typer(
    name="calibrate", help="Calibrate a run against positions and reflectors.", no_args_is_help=True
)

Run = Annotated[Path, Argument(help="Run store.")]
NewRun = Annotated[
    Path | None, Option("-o", "--output", help="Run store to make with what was found.")
]

Reflectors = Annotated[Path, Option(help="CSV of reflectors: x_m, y_m, z_m in the lane frame.")]
Tolerance = Annotated[
    float,
    Option(
        help="How far from its place an echo may come, and how far apart reflectors' biases may lie, m."
    ),
]
Offsets = Annotated[
    tuple[float, float], Option(help="Least and greatest offset of the track's clock, s.")
]
TrackFile = Annotated[
    Path | None, Option("--track", help="CSV track or NMEA log; NAME-track.csv by default.")
]
TrackAnchor = Annotated[Path | None, Option("--anchor", help="Anchor, to read an NMEA log.")]
Step = Annotated[
    float, Option(help="First step of the offsets, s; halved four times around the best.")
]
KeepStanding = Annotated[
    bool,
    Option(
        "--keep-standing",
        help="Search with what is the same in all scans; it is left out by default.",
    ),
]


@calibrate_app.command("clock")
def clock(
    run: Run,
    area: Annotated[
        tuple[float, float, float, float], Option(help="Ground to focus: x and y limits, m.")
    ],
    offsets: Offsets,
    output: NewRun = None,
    track: TrackFile = None,
    anchor: TrackAnchor = None,
    step: Step = 0.05,
    height: Annotated[float, Option(help="z of the area, m.")] = 0.0,
    spacing: Annotated[
        float | None, Option(help="Pixel spacing, m; a quarter wavelength by default.")
    ] = None,
    rate: Annotated[
        list[float] | None, Option(help="Clock rate to try; may repeat, 1 by default.")
    ] = None,
    keep_standing: KeepStanding = False,
    as_json: Json = False,
) -> None:
    """Find the offset between the radar's clock and the track's by focus alone; no reflector need be known.

    Ranges must be right to about their resolution: where they may be biased and reflectors are known, take joint. An
    answer at the edge of the offsets, or one that does not stand out, is refused.
    """
    with plain_errors():
        search = tasks.ClockSearch(area, offsets, step, height, spacing, tuple(rate or [1.0]))
        fit = tasks.calibrate_clock(run, search, track, output, anchor, keep_standing)
    best = float(fit.trials["sharpness"].max())
    if as_json:
        found = {
            "clock_offset_s": fit.offset,
            "clock_rate": fit.rate,
            "sharpness": best,
            "least_sharpness": fit.lowest,
        }
        typer.echo(
            json.dumps(
                {**found, "trials": len(fit.trials), "standing_part_removed": not keep_standing}
            )
        )
        return
    typer.echo(f"clock offset {fit.offset:.4f} s, rate {fit.rate:g}, from {len(fit.trials)} trials")
    typer.echo(
        f"sharpness there is {best / fit.lowest:.2f} times the least of the offsets asked for"
    )
    _tell_standing(keep_standing)
    tell_written(False, output)


@calibrate_app.command("range-bias")
def range_bias(
    run: Run,
    reflectors: Reflectors,
    output: NewRun = None,
    search: Annotated[
        float | None,
        Option(
            help="How far to either side of zero the bias is looked for, m; 3, or what unambiguous ranges allow."
        ),
    ] = None,
    tolerance: Tolerance = 0.15,
    keep_standing: KeepStanding = False,
    as_json: Json = False,
) -> None:
    """Find by how much ranges are measured too long, from reflectors at known places; the clock must be right.

    An answer that does not stand out, lies at the edge of the search, or that reflectors disagree on is refused.
    """
    with plain_errors():
        fit = tasks.calibrate_range_bias(run, reflectors, output, search, tolerance, keep_standing)
    _tell_bias(fit, keep_standing, as_json, output)


@calibrate_app.command("joint")
def joint(
    run: Run,
    reflectors: Reflectors,
    offsets: Offsets,
    biases: Annotated[tuple[float, float], Option(help="Least and greatest range bias, m.")] = (
        -3.0,
        3.0,
    ),
    output: NewRun = None,
    track: TrackFile = None,
    anchor: TrackAnchor = None,
    step: Step = 0.05,
    tolerance: Tolerance = 0.15,
    keep_standing: KeepStanding = False,
    as_json: Json = False,
) -> None:
    """Find clock offset and range bias together, from reflectors at known places, when neither is known.

    An answer that does not stand out, lies at the edge of the search, or that reflectors disagree on is refused.
    """
    with plain_errors():
        fit = tasks.calibrate_joint(
            run, reflectors, offsets, biases, output, track, anchor, step, tolerance, keep_standing
        )
    _tell_bias(fit, keep_standing, as_json, output)


def _tell_bias(fit: tasks.BiasFit, keep_standing: bool, as_json: bool, output: Path | None) -> None:
    if as_json:
        clock = (
            {}
            if fit.offset is None
            else {"clock_offset_s": fit.offset, "clock_offset_sigma_s": fit.offset_sigma}
        )
        figures = {
            "range_bias_m": fit.bias, "range_bias_sigma_m": fit.bias_sigma, "over_runner_up_db": fit.over_runner_up,
            "runner_up_m": fit.runner_up, "over_moved_db": fit.over_moved, "over_median_db": fit.over_median,
            "spread_m": fit.spread, "searched_m": fit.searched, "standing_part_removed": not keep_standing,
        }  # fmt: skip
        typer.echo(json.dumps({**clock, **figures, "reflectors": fit.points.to_dict("records")}))
        return
    if fit.offset is not None:
        typer.echo(
            f"clock offset {fit.offset:.4f} s, one standard deviation {fit.offset_sigma:.4f} s"
        )
    low, high = fit.searched
    typer.echo(
        f"range bias {fit.bias:.4f} m, one standard deviation {fit.bias_sigma:.4f} m, looked for from {low:g} to "
        f"{high:g} m"
    )
    typer.echo(
        f"the peak stands {fit.over_runner_up:.1f} dB over the next best bias ({fit.runner_up:.2f} m), "
        f"{fit.over_moved:.1f} dB over reflectors moved sideways, {fit.over_median:.1f} dB over the median"
    )
    for row in fit.points.to_dict("records"):
        typer.echo(
            f"reflector at ({row['x']:.3f}, {row['y']:.3f}) m: its echo peaks at ({row['x_peak']:.3f}, "
            f"{row['y_peak']:.3f}) m and tells {row['bias']:.4f} m"
        )
    if len(fit.points) == 1:
        typer.echo(
            "one reflector alone does not tell whether its place is wrong along the line of sight"
        )
    _tell_standing(keep_standing)
    tell_written(False, output)


def _tell_standing(kept: bool) -> None:
    part = "what stands still in the scans (coupling, the vehicle's own echoes)"
    typer.echo(f"{part} was {'kept' if kept else 'left out of the search'}")


def anchor(
    points: Annotated[Path, Argument(help="Anchor (TOML), or CSV of surveyed points.")],
    crs: Annotated[
        str | None, Option(help="CSV: reference system of the points, such as EPSG:32633.")
    ] = None,
    accuracy: Annotated[
        float | None, Option(help="CSV: standard deviation of a surveyed coordinate, m.")
    ] = None,
    write: Annotated[Path | None, Option(help="CSV: anchor (TOML) to write.")] = None,
    lane: Annotated[Path | None, Option(help="Lane (TOML) whose corners are told.")] = None,
    outline: Annotated[Path | None, Option(help="GeoJSON of the lane's outline to write.")] = None,
    run: Annotated[Path | None, Option(help="Run store to tie to the Earth.")] = None,
    output: NewRun = None,
    as_json: Json = False,
) -> None:
    """Fit a lane to surveyed points: where it lies on Earth, and how well that is known."""
    with plain_errors():
        tasks.check_request(lane, outline, run, output)
        if points.suffix.lower() == ".csv":
            if crs is None or accuracy is None or write is None:
                raise ValueError("a CSV of surveyed points needs --crs, --accuracy and --write")
            tasks.write_anchor(tasks.anchor_from_points(points, crs, accuracy), write)
            points = write
        told = tasks.tie_lane(points, lane, outline, run, output)
    if as_json:
        typer.echo(json.dumps(told))
        return
    typer.echo(
        f"lane origin at {told['latitude']:.8f} N {told['longitude']:.8f} E, +y points {told['azimuth']:.3f} degrees "
        "from true north"
    )
    misfits = ", ".join(f"{1000 * one:.0f}" for one in told["residuals_m"])
    good = f"one coordinate good to {1000 * told['sigma_m']:.0f} mm"
    typer.echo(f"{told['points']} points in {told['crs']}, misfits {misfits} mm, {good}")
    typer.echo(
        f"uncertainty at their mean {1000 * told['sigma_at_points_m']:.0f} mm (one standard deviation)"
    )
    for one in told.get("corners", []):
        typer.echo(
            f"corner ({one['x']:g}, {one['y']:g}) m at {one['latitude']:.8f} N {one['longitude']:.8f} E, "
            f"{1000 * one['sigma_m']:.0f} mm"
        )
    if told["crs_accuracy_m"] is None or told["crs_accuracy_m"] > told["sigma_m"]:
        known = "not stated" if told["crs_accuracy_m"] is None else f"{told['crs_accuracy_m']:g} m"
        typer.echo(
            f"the step from {told['crs']} to WGS 84 is not in these figures: its accuracy is {known}"
        )
    if not told["heights_known"]:
        typer.echo("the points have no heights: the ground is put on the ellipsoid")
    tell_written(False, write, outline, output)
