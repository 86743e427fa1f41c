"""``flgpr image``: focus a run, or draw the traces of a recording."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from typer import Argument, Option

from flgpr.commands.options import (
    REQUIRED,
    Limits,
    OneOrMorePaths,
    PathLike,
    Progress,
    ShellType,
    one_or_more,
)
from flgpr.commands.shell import Arguments, command

if TYPE_CHECKING:
    import pandas as pd

    from flgpr.commands.picture import Picture
    from flgpr.commands.radargram import Radargram
    from flgpr.commands.slices import Slices


def _lines(made: Picture | Slices | Radargram, call: Arguments) -> Iterator[str | Path]:
    from flgpr.commands.picture import Picture
    from flgpr.commands.slices import Slices

    if isinstance(made, Picture):
        yield from _picture_lines(made)
    elif isinstance(made, Slices):
        sizes = " x ".join(str(made.image.sizes[axis]) for axis in "xy")
        yield (
            f"{made.scans} scans, {len(call.depth)} slices of {sizes} pixels of {made.spacing:g} m"
        )
    else:
        traces, samples = made.values.shape
        yield f"{made.title}: {traces} traces x {samples} samples, {made.unit}"
        for step in made.steps:
            yield f"step: {step}"
        for note in made.notes:
            yield f"note: {note}"
    yield from call.output


def _picture_lines(made: Picture) -> Iterator[str]:
    sizes = [made.image.sizes[axis] for axis in "xyz"]
    pixels = " x ".join(str(size) for size in sizes if size > 1)
    yield f"{made.scans} scans, {pixels} pixels of {made.spacing:g} m; brightest points:"
    yield from _point_lines(made.peaks)


def _point_lines(peaks: pd.DataFrame) -> Iterator[str]:
    """Return a line per point: its place, level and widths."""
    for number, row in enumerate(peaks.to_dict("records"), 1):
        widths = []
        for name, value in row.items():
            if str(name).startswith("width") and value > 0:
                widths.append(f"{str(name)[-1]} {value:.3f}")
        width = f", -3 dB width {', '.join(widths)} m" if widths else ""
        yield (
            f"{number:3}  ({row['x']:.3f}, {row['y']:.3f}, {row['z']:.3f}) m  {row['level']:6.1f} dB, "
            f"{row['over_median']:.1f} dB over the median{width}"
        )


def _as_json(made: Picture | Slices | Radargram, call: Arguments) -> dict[str, Any]:
    from flgpr.commands.picture import Picture
    from flgpr.commands.slices import Slices

    if isinstance(made, Picture):
        return {
            "spacing_m": made.spacing,
            "scans": made.scans,
            "shape": dict(made.image.sizes),
            "peaks": json.loads(made.peaks.to_json(orient="records")),
        }
    if isinstance(made, Slices):
        return {
            "scans": made.scans,
            "depths_m": call.depth,
            "spacing_m": made.spacing,
            "shape": dict(made.image.sizes),
        }
    traces, samples = made.values.shape
    return {
        "traces": traces,
        "samples": samples,
        "unit": made.unit,
        "steps": made.steps,
        "notes": made.notes,
    }


@command(lines=_lines, as_json=_as_json)
def image(
    run: Annotated[
        PathLike,
        Argument(
            help="Run store, or a recording (.dzt, .dt1, ...), whose traces are drawn as they are."
        ),
    ],
    output: Annotated[
        OneOrMorePaths,
        Option("-o", "--output", help="What to write: .png, .npz, .zarr or .tif; may repeat."),
        REQUIRED,
        ShellType(list[Path]),
    ] = (),
    x: Annotated[Limits | None, Option(help="Limits, m, in the lane frame.")] = None,
    y: Annotated[Limits | None, Option(help="Limits, m.")] = None,
    z: Annotated[
        Limits | None, Option(help="Limits, m; the ground is at 0, depths are negative.")
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
    polarization: Annotated[
        Sequence[str] | None, Option(help="May repeat; all by default.")
    ] = None,
    band: Annotated[Limits | None, Option(help="GHz; all tones by default.")] = None,
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
        PathLike | None, Option(help="TOML that ties the lane to the Earth, for .tif.")
    ] = None,
    points: Annotated[int, Option(help="Brightest points to tell.", min=1, max=100)] = 5,
    depth: Annotated[
        Sequence[float] | None,
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
    *,
    track: Progress = None,
) -> Picture | Slices | Radargram:
    """Focus a run by one scan or over the aperture of many, or draw the traces of a recording over time.

    Returns
    -------
    Picture, Slices or Radargram
        Of a run its focused image with the brightest points, with ``depth`` the slices; of a
        recording its traces.

    Raises
    ------
    ValueError
        If the options do not fit one another or the data, or an output has another ending.
    FileExistsError
        If another file is at an output.
    """
    from flgpr.commands.radargram import RadargramView, is_recording, make_radargram

    outputs = one_or_more(output)
    limits = scans if scan is None else (scan, scan)
    if is_recording(run):
        _refuse_options_of_runs(
            {
                "x": x,
                "y": y,
                "z": z,
                "at-x": at_x,
                "at-y": at_y,
                "at-z": at_z,
                "spacing": spacing,
                "polarization": polarization,
                "band": band,
                "ground": ground,
                "reach": reach,
                "anchor": anchor,
                "depth": depth or None,
            }
        )
        seconds = [None if time is None else time * 1e-9 for time in (until, step_window)]
        drawn = RadargramView(
            channel, limits, seconds[0], dewow, background, gain, seconds[1], permittivity
        )
        return make_radargram(run, drawn, outputs)
    _refuse_other_files(Path(run))
    _refuse_options_of_recordings(
        {"dewow": dewow, "background": background, "gain": gain}, (channel, until, step_window)
    )
    if scan is not None and scans is not None:
        raise ValueError("scan and scans must not both be told")
    from flgpr.chain.progress import silent
    from flgpr.commands.picture import make_picture
    from flgpr.commands.slices import make_slices
    from flgpr.imaging import View

    view = View(
        x=_extent("x", x, at_x),
        y=_extent("y", y, at_y),
        z=_extent("z", z, at_z),
        spacing=spacing,
        scans=limits,
        polarizations=tuple(polarization or ()),
        band=None if band is None else (band[0] * 1e9, band[1] * 1e9),
        window=window,
        permittivity=permittivity,
        half_space=ground,
        reach=math.inf if reach is None else reach,
    )
    if depth:
        return make_slices(run, depth, view, outputs, track or silent)
    return make_picture(run, view, outputs, anchor, points, track or silent)


def _extent(name: str, limits: Limits | None, value: float | None) -> Limits | float | None:
    """Return limits or one value; both are a ValueError."""
    if limits is not None and value is not None:
        raise ValueError(f"{name} must be told once, got limits and --at-{name}")
    return limits if value is None else value


def _refuse_other_files(path: Path) -> None:
    """Refuse a file that is no recording, with what can be drawn; a run is a folder."""
    if not path.is_file():
        return
    from flgpr.formats.gpr_files import READERS
    from flgpr.store.files import existing

    existing(path)  # tells a pointer of Git LFS
    raise ValueError(
        f"{path}: a run or a recording ({', '.join(READERS)}) can be drawn, got the ending {path.suffix!r}; "
        "flgpr info tells how arrays are imported"
    )


def _refuse_options_of_runs(options: dict[str, Any]) -> None:
    refused = [name for name, value in options.items() if value is not None]
    if refused:
        raise ValueError(
            f"{', '.join(refused)}: a recording is drawn as it is; to focus it, import it first: flgpr import gpr"
        )


def _refuse_options_of_recordings(steps: dict[str, bool], others: tuple[Any, ...]) -> None:
    channel, until, step_window = others
    refused = [name for name, wanted in steps.items() if wanted]
    if refused or channel or until is not None or step_window is not None:
        names = ", ".join(refused) or "channel, until or step-window"
        raise ValueError(
            f"{names}: these are for recordings; of a run, `flgpr prepare` takes the steps"
        )
