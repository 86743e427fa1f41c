"""Commands that prepare raw data and focus them: prepare, image."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer import Argument, Option

from flgpr import tasks
from flgpr.cli.calibration import calibrate_app
from flgpr.cli.common import Json, Output, Quiet, plain_errors, progress, tell_written

if TYPE_CHECKING:
    import pandas as pd

Run = Annotated[Path, Argument(help="Run store.")]
RunOrRecording = Annotated[
    Path,
    Argument(
        help="Run store, or a recording (.dzt, .dt1, ...), whose traces are drawn as they are."
    ),
]
Pair = tuple[float, float]


def prepare(
    run: Run,
    output: Output,
    subtract: Annotated[
        Path | None, Option(help="Run to subtract, such as one without the target.")
    ] = None,
    time_zero: Annotated[float | None, Option(help="How much later time zero is put, ns.")] = None,
    dewow: Annotated[
        float | None, Option(help="Take a running mean of so many ns off each trace.")
    ] = None,
    gate: Annotated[
        Pair | None, Option(help="Silence what comes before and after, ns: the direct wave.")
    ] = None,
    background: Annotated[
        bool, Option("--background", help="Take off what stands still over all scans.")
    ] = False,
    background_scans: Annotated[
        int | None, Option(help="The same, over so many scans around each.")
    ] = None,
    band: Annotated[Pair | None, Option(help="Band to keep, GHz.")] = None,
    power: Annotated[float | None, Option(help="Amplify by this power of time.")] = None,
    agc: Annotated[
        float | None, Option(help="Bring all times to one level, over a window of so many ns.")
    ] = None,
    steps: Annotated[
        Path | None, Option(help="TOML of steps in an order of your own, in place of all these.")
    ] = None,
    max_memory: Annotated[str, Option(help="Memory that it may take.")] = "2GB",
    quiet: Quiet = False,
) -> None:
    """Prepare raw data, in the order of the options; what was done stands in the new run's history."""
    with plain_errors(quiet):
        chosen: dict[str, dict[str, Any] | None] = {
            "subtract": None if subtract is None else {"run": str(subtract)},
            "time-zero": None if time_zero is None else {"delay_ns": time_zero},
            "dewow": None if dewow is None else {"length_ns": dewow},
            "gate": None if gate is None else {"start_ns": gate[0], "stop_ns": gate[1]},
            "background": {"scans": background_scans}
            if background or background_scans is not None
            else None,
            "band": None if band is None else {"low_ghz": band[0], "high_ghz": band[1]},
            "power": None if power is None else {"exponent": power},
            "agc": None if agc is None else {"window_ns": agc},
        }
        wanted = [
            {"do": name, **entries} for name, entries in chosen.items() if entries is not None
        ]
        if steps is not None and wanted:
            raise ValueError(
                f"steps must stand alone, got {steps} and {', '.join(one['do'] for one in wanted)}"
            )
        listed = tasks.read_steps(steps) if steps is not None else tasks.check_steps(wanted)
        tasks.prepare_run(run, listed, output, tasks.parse_size(max_memory))
    tell_written(quiet, output)


def image(
    run: RunOrRecording,
    output: Annotated[
        list[Path],
        Option("-o", "--output", help="What to write: .png, .npz, .zarr or .tif; may repeat."),
    ],
    x: Annotated[Pair | None, Option(help="Limits, m, in the lane frame.")] = None,
    y: Annotated[Pair | None, Option(help="Limits, m.")] = None,
    z: Annotated[
        Pair | None, Option(help="Limits, m; the ground is at 0, depths are negative.")
    ] = None,
    at_x: Annotated[float | None, Option(help="One x, for a section along y.")] = None,
    at_y: Annotated[float | None, Option(help="One y, for a section along x.")] = None,
    at_z: Annotated[float | None, Option(help="One z; 0 by default.")] = None,
    spacing: Annotated[
        float | None, Option(help="Of pixels, m; a quarter of the wavelength by default.")
    ] = None,
    scans: Annotated[
        tuple[int, int] | None, Option(help="First and last scan to sum; all by default.")
    ] = None,
    scan: Annotated[int | None, Option(help="A single scan.")] = None,
    polarization: Annotated[list[str] | None, Option(help="May repeat; all by default.")] = None,
    band: Annotated[Pair | None, Option(help="GHz; all tones by default.")] = None,
    window: Annotated[str, Option(help="boxcar, hann, hamming or taylor.")] = "hann",
    permittivity: Annotated[
        float | None, Option(help="Of all that waves go through: the ground's, for antennas on it.")
    ] = None,
    ground: Annotated[
        float | None, Option(help="Permittivity of ground below z = 0 that refracts.")
    ] = None,
    reach: Annotated[
        float | None, Option(help="How far antennas may be from what they help to image, m.")
    ] = None,
    anchor: Annotated[
        Path | None, Option(help="TOML that ties the lane to the Earth, for .tif.")
    ] = None,
    points: Annotated[int, Option(help="Brightest points to tell.", min=1, max=100)] = 5,
    depth: Annotated[
        list[float] | None,
        Option(help="Depth slices in place of z: a depth below z = 0, m; may repeat."),
    ] = None,
    channel: Annotated[int, Option(help="Recording: channel, from 0.", min=0)] = 0,
    until: Annotated[
        float | None, Option(help="Recording: last two-way time, ns; all by default.")
    ] = None,
    dewow: Annotated[
        bool, Option("--dewow", help="Recording: take the running mean off each trace.")
    ] = False,
    background: Annotated[
        bool, Option("--background", help="Recording: take off the mean of all traces.")
    ] = False,
    gain: Annotated[
        bool, Option("--gain", help="Recording: bring all times to the line's mean level.")
    ] = False,
    step_window: Annotated[
        float | None,
        Option(
            help="Recording: window of dewow and gain, ns; two periods of the antenna by default."
        ),
    ] = None,
    quiet: Quiet = False,
    as_json: Json = False,
) -> None:
    """Focus a run by one scan or over the aperture of many, or draw the traces of a recording over time."""
    if tasks.is_recording(run):
        of_runs = {
            "x": x, "y": y, "z": z, "at-x": at_x, "at-y": at_y, "at-z": at_z, "spacing": spacing,
            "polarization": polarization, "band": band, "ground": ground, "reach": reach, "anchor": anchor,
            "depth": depth or None,
        }  # fmt: skip
        _draw_recording(
            run, output, of_runs, scans if scan is None else (scan, scan), channel, until, dewow, background, gain,
            step_window, permittivity, quiet, as_json,
        )  # fmt: skip
        return
    with plain_errors(quiet), progress(quiet or as_json) as track:
        of_recordings = {"dewow": dewow, "background": background, "gain": gain}
        asked = [name for name, wanted in of_recordings.items() if wanted]
        if asked or channel or until is not None or step_window is not None:
            named = ", ".join(asked) or "channel, until or step-window"
            raise ValueError(
                f"{named}: these are for recordings; of a run, `flgpr prepare` takes the steps"
            )
        for name, pair, one in (("x", x, at_x), ("y", y, at_y), ("z", z, at_z)):
            if pair is not None and one is not None:
                raise ValueError(f"{name} must be told once, got limits and --at-{name}")
        if scan is not None and scans is not None:
            raise ValueError("scan and scans must not both be told")
        view = tasks.View(
            x if at_x is None else at_x, y if at_y is None else at_y, z if at_z is None else at_z, spacing,
            scans if scan is None else (scan, scan), tuple(polarization or ()),
            None if band is None else (band[0] * 1e9, band[1] * 1e9), window, permittivity, ground,
            float("inf") if reach is None else reach,
        )  # fmt: skip
        if depth:
            slices = tasks.make_slices(run, depth, view, output, track)
            sizes = " x ".join(str(slices.image.sizes[axis]) for axis in "xy")
            if as_json:
                shape = dict(slices.image.sizes)
                told = {
                    "scans": slices.scans,
                    "depths_m": depth,
                    "spacing_m": slices.spacing,
                    "shape": shape,
                }
                typer.echo(json.dumps(told))
            elif not quiet:
                typer.echo(
                    f"{slices.scans} scans, {len(depth)} slices of {sizes} pixels of {slices.spacing:g} m"
                )
            tell_written(quiet or as_json, *output)
            return
        made = tasks.make_picture(run, view, output, anchor, points, track)
    if as_json:
        found = {"spacing_m": made.spacing, "scans": made.scans, "shape": dict(made.image.sizes)}
        typer.echo(json.dumps(found | {"peaks": json.loads(made.peaks.to_json(orient="records"))}))
        return
    if not quiet:
        sizes = " x ".join(
            f"{made.image.sizes[axis]}" for axis in "xyz" if made.image.sizes[axis] > 1
        )
        typer.echo(f"{made.scans} scans, {sizes} pixels of {made.spacing:g} m; brightest points:")
        for line in _point_lines(made.peaks):
            typer.echo(line)
    tell_written(quiet, *output)


def _draw_recording(
    path: Path,
    output: list[Path],
    of_runs: dict[str, Any],
    traces: tuple[int, int] | None,
    channel: int,
    until: float | None,
    dewow: bool,
    background: bool,
    gain: bool,
    window: float | None,
    permittivity: float | None,
    quiet: bool,
    as_json: bool,
) -> None:
    """Draw the traces of a recording, and tell what was assumed and done."""
    with plain_errors(quiet):
        refused = [name for name, value in of_runs.items() if value is not None]
        if refused:
            raise ValueError(
                f"{', '.join(refused)}: a recording is drawn as it is; to focus it, import it first: flgpr import gpr"
            )
        view = tasks.RadargramView(
            channel,
            traces,
            None if until is None else until * 1e-9,
            dewow,
            background,
            gain,
            None if window is None else window * 1e-9,
            permittivity,
        )
        made = tasks.make_radargram(path, view, output)
    if as_json:
        shape = {"traces": made.values.shape[0], "samples": made.values.shape[1]}
        typer.echo(
            json.dumps(shape | {"unit": made.unit, "steps": made.steps, "notes": made.notes})
        )
        return
    if not quiet:
        typer.echo(
            f"{made.title}: {made.values.shape[0]} traces x {made.values.shape[1]} samples, {made.unit}"
        )
        for step in made.steps:
            typer.echo(f"step: {step}")
        for note in made.notes:
            typer.echo(f"note: {note}")
    tell_written(quiet, *output)


@calibrate_app.command("permittivity")
def permittivity(
    run: Run,
    along: Annotated[
        Pair | None, Option(help="Stretch of the line that holds hyperbolas, m; all by default.")
    ] = None,
    delays: Annotated[Pair, Option(help="Delays that hold them, ns.")] = (1.0, 30.0),
    limits: Annotated[Pair, Option(help="Least and greatest permittivity to try.")] = (2.0, 36.0),
    quiet: Quiet = False,
    as_json: Json = False,
) -> None:
    """Find the ground's permittivity by the focus of hyperbolas, for antennas that are coupled to the ground."""
    with plain_errors(quiet), progress(quiet or as_json) as track:
        if not 1 <= limits[0] < limits[1]:
            raise ValueError(
                f"limits must increase from 1 or more, got {limits[0]:g}, {limits[1]:g}"
            )
        steps = [limits[0] * (limits[1] / limits[0]) ** (k / 40) for k in range(41)]
        fit = tasks.find_permittivity(
            run, along, (delays[0] * 1e-9, delays[1] * 1e-9), steps, track
        )
    speed = 0.299792458 / fit.permittivity**0.5
    if as_json:
        told = {
            "permittivity": fit.permittivity,
            "speed_m_per_ns": speed,
            "sharpness_over_median": fit.contrast,
        }
        typer.echo(json.dumps(told))
    else:
        typer.echo(f"permittivity {fit.permittivity:.2f}: {speed:.4f} m/ns")
        typer.echo(f"sharpness there is {fit.contrast:.2f} times the median of all trials")


def _point_lines(peaks: pd.DataFrame) -> list[str]:
    """Give a line per point: its place, level and widths."""
    lines = []
    for number, row in enumerate(peaks.to_dict("records"), 1):
        widths = [
            f"{str(name)[-1]} {value:.3f}"
            for name, value in row.items()
            if str(name).startswith("width") and value > 0
        ]
        lines.append(
            f"{number:3}  ({row['x']:.3f}, {row['y']:.3f}, {row['z']:.3f}) m  {row['level']:6.1f} dB, "
            f"{row['over_median']:.1f} dB over the median"
            + (f", -3 dB width {', '.join(widths)} m" if widths else "")
        )
    return lines
