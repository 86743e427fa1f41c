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
NewRun = Annotated[Path | None, Option("-o", "--output", help="Run store to make with what was found.")]


@calibrate_app.command("clock")
def clock(
    run: Run,
    area: Annotated[tuple[float, float, float, float], Option(help="Ground to focus: x and y limits, m.")],
    offsets: Annotated[tuple[float, float], Option(help="Least and greatest offset of the track's clock, s.")],
    output: NewRun = None,
    track: Annotated[Path | None, Option(help="CSV track or NMEA log; NAME-track.csv by default.")] = None,
    anchor: Annotated[Path | None, Option(help="Anchor, to read an NMEA log.")] = None,
    step: Annotated[float, Option(help="First step, s; halved four times around the best.")] = 0.05,
    height: Annotated[float, Option(help="z of the area, m.")] = 0.0,
    spacing: Annotated[float | None, Option(help="Pixel spacing, m; a quarter wavelength by default.")] = None,
    rate: Annotated[list[float] | None, Option(help="Clock rate to try; may repeat, 1 by default.")] = None,
    as_json: Json = False,
) -> None:
    """Find the offset between the radar's clock and the track's by focus alone; no reflector need be known."""
    with plain_errors():
        search = tasks.ClockSearch(area, offsets, step, height, spacing, tuple(rate or [1.0]))
        fit = tasks.calibrate_clock(run, search, track, output, anchor)
    best, median = float(fit.trials["sharpness"].max()), float(fit.trials["sharpness"].median())
    edge = not offsets[0] < fit.offset < offsets[1]
    if as_json:
        found = {"clock_offset_s": fit.offset, "clock_rate": fit.rate, "sharpness": best, "median_sharpness": median}
        typer.echo(json.dumps({**found, "at_the_edge": edge, "trials": len(fit.trials)}))
        return
    typer.echo(f"clock offset {fit.offset:.4f} s, rate {fit.rate:g}, from {len(fit.trials)} trials")
    typer.echo(f"sharpness there is {best / median:.2f} times the median of all trials")
    if edge:
        typer.echo("warning: the best offset lies at the edge of what was tried: search farther")
    elif best < 1.2 * median:
        typer.echo("warning: no offset stands out: is there anything bright in the area?")
    tell_written(False, output)


@calibrate_app.command("range-bias")
def range_bias(
    run: Run,
    reflectors: Annotated[Path, Option(help="CSV of reflectors: x_m, y_m, z_m in the lane frame.")],
    output: NewRun = None,
    search: Annotated[float, Option(help="How far from a reflector its echo is looked for, m.")] = 0.6,
    as_json: Json = False,
) -> None:
    """Find by how much ranges are measured too long, from reflectors at known places."""
    with plain_errors():
        fit = tasks.calibrate_range_bias(run, reflectors, output, search)
    if as_json:
        typer.echo(json.dumps({"range_bias_m": fit.bias, "reflectors": fit.points.to_dict("records")}))
        return
    typer.echo(f"range bias {fit.bias:.4f} m")
    for row in fit.points.to_dict("records"):
        typer.echo(
            f"reflector at ({row['x']:.3f}, {row['y']:.3f}) m: its echo peaks at ({row['x_peak']:.3f}, "
            f"{row['y_peak']:.3f}) m and tells {row['bias']:.4f} m"
        )
    tell_written(False, output)


def anchor(
    points: Annotated[Path, Argument(help="Anchor (TOML), or CSV of surveyed points.")],
    crs: Annotated[str | None, Option(help="CSV: reference system of the points, such as EPSG:32633.")] = None,
    accuracy: Annotated[float | None, Option(help="CSV: standard deviation of a surveyed coordinate, m.")] = None,
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
    typer.echo(f"uncertainty at their mean {1000 * told['sigma_at_points_m']:.0f} mm (one standard deviation)")
    for one in told.get("corners", []):
        typer.echo(
            f"corner ({one['x']:g}, {one['y']:g}) m at {one['latitude']:.8f} N {one['longitude']:.8f} E, "
            f"{1000 * one['sigma_m']:.0f} mm"
        )
    if told["crs_accuracy_m"] is None or told["crs_accuracy_m"] > told["sigma_m"]:
        known = "not stated" if told["crs_accuracy_m"] is None else f"{told['crs_accuracy_m']:g} m"
        typer.echo(f"the step from {told['crs']} to WGS 84 is not in these figures: its accuracy is {known}")
    if not told["heights_known"]:
        typer.echo("the points have no heights: the ground is put on the ellipsoid")
    tell_written(False, write, outline, output)
