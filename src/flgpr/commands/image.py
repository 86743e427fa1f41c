"""``flgpr image``: focus a run, or draw the traces of a recording."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from typer import Option

from flgpr.commands.options import (
    OUTPUT,
    REQUIRED,
    AnchorOption,
    Limits,
    OneOrMorePaths,
    PathLike,
    Progress,
    ShellType,
    one_or_more,
)
from flgpr.commands.shell import Arguments, command, options_given

if TYPE_CHECKING:
    from flgpr.commands.picture import Picture, Slices
    from flgpr.commands.radargram import Radargram

_OF_BOTH = {"run", "output", "scans", "scan", "permittivity"}  # of runs and of recordings


def _lines(drawn: Picture | Slices | Radargram, call: Arguments) -> Iterator[str | Path]:
    """Yield the text about what was drawn, and the files."""
    yield from drawn.lines()
    yield from call.output


@command(
    lines=_lines,
    as_json=True,
)
def image(
    run: PathLike,
    output: Annotated[
        OneOrMorePaths,
        OUTPUT,
        REQUIRED,
        ShellType(list[Path]),
    ] = (),
    x: Limits | None = None,
    y: Limits | None = None,
    z: Limits | None = None,
    at_x: float | None = None,
    at_y: float | None = None,
    at_z: float | None = None,
    spacing: float | None = None,
    scans: tuple[int, int] | None = None,
    scan: int | None = None,
    polarization: Sequence[str] | None = None,
    band: Limits | None = None,
    window: str = "hann",
    permittivity: float | None = None,
    ground: float | None = None,
    reach: float | None = None,
    anchor: AnchorOption = None,
    points: Annotated[int, Option(min=1, max=100)] = 5,
    depth: Sequence[float] | None = None,
    channel: Annotated[int, Option(min=0)] = 0,
    until: float | None = None,
    dewow: bool = False,
    background: bool = False,
    gain: bool = False,
    step_window: float | None = None,
    *,
    track: Progress = None,
) -> Picture | Slices | Radargram:
    """Focus a run over the aperture of its scans, or draw the traces of a recording over time.

    Parameters
    ----------
    run
        Run store, or a recording (.dzt, .dt1, ...), whose traces are drawn as they are.
    output
        .png, .npz, .zarr or .tif; may repeat
    anchor
        for .tif
    points
        Number of brightest points.

    Ground
    ------
    x
        Limits, m, in the lane frame.
    y
        Limits, m.
    z
        Limits, m; the ground is at 0, depths are negative.
    at_x
        One x, for a section along y.
    at_y
        One y, for a section along x.
    at_z
        One z; 0 by default.
    depth
        Depth slices in place of z: a depth below z = 0, m; may repeat.
    spacing
        Of pixels, m; a quarter of the wavelength by default.

    Scans and band
    --------------
    scans
        First and last scan to sum; all by default.
    scan
        A single scan.
    polarization
        May repeat; all by default.
    band
        GHz; all tones by default.
    window
        boxcar, hann, hamming or taylor.
    reach
        Largest distance of an antenna from the pixels it contributes to, m.

    Waves in the ground
    -------------------
    permittivity
        Permittivity along all paths: the ground's, for antennas on it.
    ground
        Permittivity of ground below z = 0 that refracts.

    Recordings
    ----------
    channel
        Recording: channel, from 0.
    until
        Recording: last two-way time, ns; all by default.
    dewow
        Recording: subtract the running mean from each trace.
    background
        Recording: subtract the mean of all traces.
    gain
        Recording: divide by the line's mean level at each time.
    step_window
        Recording: window of dewow and gain, ns; two periods of the antenna by default.

    Returns
    -------
    Picture, Slices or Radargram
        For a run its focused image with the brightest points, or with ``depth`` the slices; for a
        recording its traces.

    Raises
    ------
    ValueError
        If the options do not fit one another or the data, or an output has another ending.
    FileExistsError
        If another file is at an output.
    """
    asked = locals()
    from flgpr.commands.radargram import RadargramView, make_radargram
    from flgpr.formats.reader import is_recording

    outputs = one_or_more(output)
    if scan is not None and scans is not None:
        raise ValueError("give scan or scans, got both")
    limits = scans if scan is None else (scan, scan)
    of_recordings = options_given(image, asked, "Recordings")
    of_runs = [
        name for name in options_given(image, asked) if name not in (*of_recordings, *_OF_BOTH)
    ]
    if is_recording(run):
        # A recording has no poses and no aperture: these options would have no effect.
        if of_runs:
            raise ValueError(
                f"{_typed(of_runs)}: a recording is drawn as it is; "
                "to focus it, import it first: flgpr import gpr"
            )
        if step_window is not None and not (dewow or gain):
            raise ValueError("step-window is of dewow and gain, got neither")
        radargram_view = RadargramView(
            channel=channel,
            traces=limits,
            until=_seconds(until),
            dewow=dewow,
            background=background,
            gain=gain,
            window=_seconds(step_window),
            permittivity=permittivity,
        )
        return make_radargram(run, radargram_view, outputs)

    _refuse_other_files(Path(run))
    if of_recordings:
        raise ValueError(
            f"{_typed(of_recordings)}: these are for recordings; of a run, `flgpr prepare` takes "
            "the steps"
        )

    from flgpr.commands.picture import make_picture, make_slices
    from flgpr.imaging import View
    from flgpr.progress import silent

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

    if reach is not None and not reach > 0:
        raise ValueError(f"reach must be positive (m), got {reach:g}")
    if anchor is not None and not any(Path(one).suffix.lower() == ".tif" for one in outputs):
        raise ValueError("anchor is of a GeoTIFF (.tif), got no such output")
    if depth:
        if anchor is not None or points != 5:
            raise ValueError("anchor and points are of one picture, not of depth slices")
        return make_slices(run, depth, view, outputs, track or silent)
    return make_picture(run, view, outputs, anchor, points, track or silent)


def _typed(names: Sequence[str]) -> str:
    """Return names of options as they are typed."""
    return ", ".join(names).replace("_", "-")


def _seconds(nanoseconds: float | None) -> float | None:
    """Return a time in seconds, where it was given."""
    return None if nanoseconds is None else nanoseconds * 1e-9


def _extent(name: str, limits: Limits | None, value: float | None) -> Limits | float | None:
    """Return limits or a single value; both are a ValueError."""
    if limits is not None and value is not None:
        raise ValueError(f"{name} must be given once, got limits and at_{name}")
    return limits if value is None else value


def _refuse_other_files(path: Path) -> None:
    """Refuse a file that is no recording, and name what can be drawn; a run is a folder."""
    if not path.is_file():
        return
    from flgpr.formats.reader import readers
    from flgpr.store.files import existing

    existing(path)  # refuses a pointer of Git LFS
    endings = [ending for reader in readers() for ending in reader.endings]
    raise ValueError(
        f"{path}: a run or a recording ({', '.join(endings)}) can be drawn, "
        f"got the ending {path.suffix!r}; flgpr info describes how arrays are imported"
    )
