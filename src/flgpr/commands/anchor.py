"""``flgpr anchor``: fit a lane to surveyed points."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from flgpr.commands.options import LaneOption, OptionalOutput, PathLike
from flgpr.commands.shell import Arguments, command


def _lines(fit: dict[str, Any], call: Arguments) -> Iterator[str | Path]:
    """Yield where the lane lies, how well that is known, what is assumed, and the files."""
    yield (
        f"lane origin at {fit['latitude']:.8f} N {fit['longitude']:.8f} E, "
        f"+y points {fit['azimuth']:.3f} degrees from true north"
    )
    misfits = ", ".join(f"{1000 * misfit:.0f}" for misfit in fit["residuals_m"])
    yield (
        f"{fit['points']} points in {fit['crs']}, misfits {misfits} mm, "
        f"one coordinate good to {1000 * fit['sigma_m']:.0f} mm"
    )
    at_points = 1000 * fit["sigma_at_points_m"]
    yield f"uncertainty at their mean {at_points:.0f} mm (one standard deviation)"
    for corner in fit.get("corners", []):
        yield (
            f"corner ({corner['x']:g}, {corner['y']:g}) m at {corner['latitude']:.8f} N "
            f"{corner['longitude']:.8f} E, {1000 * corner['sigma_m']:.0f} mm"
        )
    crs_accuracy = fit["crs_accuracy_m"]
    if crs_accuracy is None or crs_accuracy > fit["sigma_m"]:
        stated = "not stated" if crs_accuracy is None else f"{crs_accuracy:g} m"
        yield (
            f"the step from {fit['crs']} to WGS 84 is not in these figures: "
            f"its accuracy is {stated}"
        )
    if not fit["heights_known"]:
        yield "the points have no heights: the ground is assumed on the ellipsoid"
    for path in (call.write, call.outline, call.output):
        if path is not None:
            yield path


@command(lines=_lines, as_json=True, quiet=False)
def anchor(
    points: PathLike,
    crs: str | None = None,
    accuracy: float | None = None,
    write: PathLike | None = None,
    lane: LaneOption = None,
    outline: PathLike | None = None,
    run: PathLike | None = None,
    output: OptionalOutput = None,
) -> dict[str, Any]:
    """Fit a lane to surveyed points: its position on the Earth, and the uncertainty.

    Parameters
    ----------
    points
        Anchor (TOML), or CSV of surveyed points.
    crs
        CSV: reference system of the points, such as EPSG:32633.
    accuracy
        CSV: standard deviation of a surveyed coordinate, m.
    write
        CSV: anchor (TOML) to write.
    outline
        GeoJSON of the lane's outline to write.
    run
        Run store to tie to the Earth.
    lane
        its corners are computed
    output
        run store with its georeference

    Returns
    -------
    dict
        Position and direction, the misfit of every point, and the uncertainty at the points' mean
        and at the lane's corners; m, degrees.

    Raises
    ------
    ValueError
        If the points do not fix a lane, or options that go together are not given together.
    FileExistsError
        If another file or run is at an output.
    """
    from flgpr.commands.anchoring import tie_lane, write_anchor

    needs_lane = outline is not None and lane is None
    is_half_given = (output is None) != (run is None)
    if needs_lane or is_half_given:
        raise ValueError("an outline needs a lane, and a run and its output go together")
    path = Path(points)
    if path.suffix.lower() == ".csv":
        if crs is None or accuracy is None or write is None:
            raise ValueError("a CSV of surveyed points needs `crs`, `accuracy` and `write`")
        path = write_anchor(path, crs, accuracy, write)
    elif (crs, accuracy, write) != (None, None, None):
        raise ValueError(f"crs, accuracy and write go with a CSV of surveyed points, got {path}")
    return tie_lane(path, lane, outline, run, output)
