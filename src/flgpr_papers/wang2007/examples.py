"""Images of single targets for the figures of Wang et al. 2007."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from flgpr.imaging import ScanImager
from flgpr.kernels.sampling import bilinear
from flgpr.method.imaged_run import ImagedRun
from flgpr.model import lane_to_scan
from flgpr.types import AnyArray, Entries, Float32Array, FloatArray, floats
from flgpr_papers.kit.cache import write_arrays

_AHEAD = 11.0  # m before the array at which an example target is shown
_CONSECUTIVE = 5
_LABEL_RADIUS = 1.0  # m, r_label


class Example(NamedTuple):
    """A target or a false alarm that a figure shows."""

    place: Any  #: (3,) position of the target on the ground, lane frame, m
    alarm: Any  #: (3,) the same of its alarm
    title: str  #: what it is, in words


def save_examples(path: Path, imaged: ImagedRun, truth: pd.DataFrame, alarms: pd.DataFrame) -> None:
    """Save the scan images and patches of Figs. 2-5, 8 and 10.

    Parameters
    ----------
    path : Path
        Bundle to write.
    imaged : ImagedRun
        The lane's run with its backgrounds.
    truth : DataFrame
        The lane's targets.
    alarms : DataFrame
        The lane's alarms.
    """
    table = imaged.recipe.image
    imager = ScanImager(imaged.run, table.grid(), table.subbands, table.window, table.tolerance)
    poses = imaged.run["pose"].values
    examples = example_targets(truth, alarms)
    arrays: Entries = {
        "polarization": imaged.run["polarization"].values.astype(str),
        "subband": np.array(list(table.subbands)),
        "x": imager.grid.x,
        "y": imager.grid.y,
        "near": imaged.near.ny,
    }
    for name, example in examples.items():
        for array_name, array in _example_arrays(imager, imaged, example).items():
            arrays[f"{array_name}_{name}"] = array
    hh = list(arrays["polarization"]).index("HH")
    f1 = list(table.subbands).index(imaged.recipe.prescreen.subband)
    surface = examples["surface"]
    series = series_scans(imager.scans, poses, surface.place[1], sum(table.y) / 2)
    arrays["series"] = np.stack([np.abs(imager.image(scan).values[hh, f1]) for scan in series])
    arrays["series_place"] = np.stack(
        [lane_to_scan(surface.place, poses[scan])[:2] for scan in series]
    )
    arrays["signature"] = np.abs(imaged.whole_background.signature[hh, f1])
    arrays["gain"] = imaged.whole_background.gain[hh, f1]
    arrays["names"] = np.array(list(examples))
    arrays["titles"] = np.array([example.title for example in examples.values()])
    write_arrays(path, arrays)


def _example_arrays(imager: ScanImager, imaged: ImagedRun, example: Example) -> Entries:
    """Return the arrays of an example: its image, as it is and imaged, and its patches."""
    poses = imaged.run["pose"].values
    ahead = example.place[1] - poses[imager.scans, 1]
    index = int(np.argmin(np.abs(ahead - _AHEAD)))
    scan = int(imager.scans[index])
    image = imager.image(scan).values
    # An image of zeros is stored in half the space.
    raw_type = np.float16 if image.max() == 0 else np.float32
    patches, distances = _patches(imaged, example.alarm)
    return {
        "raw": np.abs(image).astype(raw_type),
        "clean": imaged.whole_background.magnitude(image, imaged.gains[index]),
        "place": lane_to_scan(example.place, poses[scan])[:2],
        "patches": patches,
        "distances": distances,
    }


def example_targets(truth: pd.DataFrame, alarms: pd.DataFrame) -> dict[str, Example]:
    """Return the targets of Figs. 2 to 5, 8 and 10: mines by kind and depth, and a false alarm.

    Of several mines that fit, the one with the strongest alarm is taken; of none the mine nearest
    in depth.

    Parameters
    ----------
    truth : DataFrame
        The lane's targets.
    alarms : DataFrame
        The lane's alarms.

    Returns
    -------
    dict
        ``surface``, a plastic mine on the ground; ``metal``, a metal mine 15 cm deep; ``shallow``,
        a metal mine 5 cm deep; ``plastic``, a plastic mine 5 cm deep; ``false``, the strongest
        false alarm.
    """
    mines = truth[truth["kind"].isin(["metal", "plastic"])]
    plastic = mines[mines["kind"] == "plastic"]
    metal = mines[mines["kind"] == "metal"]
    return {
        "surface": _example(plastic, -1.0, mines, alarms),
        "metal": _example(metal, 0.15, mines, alarms),
        "shallow": _example(metal[metal["depth"] > 0], 0.05, mines, alarms),
        "plastic": _example(plastic[plastic["depth"] > 0], 0.05, mines, alarms),
        "false": _false_alarm(truth, alarms),
    }


def _false_alarm(truth: pd.DataFrame, alarms: pd.DataFrame) -> Example:
    """Return the strongest alarm in the lane that is far from every target."""
    distance = _distances(alarms, truth).min(axis=1)
    candidates = alarms[(distance > 2) & (alarms["x"].abs() < 1.5)]
    if candidates.empty:
        candidates = alarms
    place = _ground(candidates.sort_values("confidence", ascending=False).iloc[0])
    return Example(place, place, "strongest false alarm")


def _ground(row: pd.Series[Any]) -> FloatArray:
    """Return the position (3,) of a target or alarm on the ground, m."""
    return floats([row["x"], row["y"], 0.0])


def _example(
    table: pd.DataFrame, depth: float, all_mines: pd.DataFrame, alarms: pd.DataFrame
) -> Example:
    """Return the mine nearest in depth with the strongest alarm within 1 m.

    A mine without an alarm is cut at its own position. ``all_mines`` stand in for an empty table.
    """
    mines = table if len(table) else all_mines
    depth_error = (mines["depth"] - depth).abs()
    candidates = mines[depth_error <= depth_error.min() + 0.02]
    is_hit = _distances(alarms, candidates) <= _LABEL_RADIUS
    confidence = np.where(is_hit, alarms["confidence"].to_numpy()[:, None], -np.inf)
    alarm, number = np.unravel_index(int(np.argmax(confidence)), confidence.shape)
    has_alarm = bool(is_hit[alarm, number])
    target = candidates.iloc[int(number) if has_alarm else 0]
    position = alarms.iloc[int(alarm)] if has_alarm else target
    title = f"{target['kind']} mine "
    title += "on the surface" if target["depth"] < 0 else f"{100 * target['depth']:.0f} cm deep"
    if not has_alarm:
        title += ", no alarm: cut at the mine"
    return Example(_ground(target), _ground(position), title)


def _distances(alarms: pd.DataFrame, targets: pd.DataFrame) -> FloatArray:
    """Return the distance (alarm, target) of every alarm from every target, m."""
    gap = alarms[["x", "y"]].to_numpy()[:, None] - targets[["x", "y"]].to_numpy()
    return np.hypot(*gap.transpose(2, 0, 1))


def series_scans(scans: AnyArray, poses: FloatArray, y: float, middle: float) -> list[int]:
    """Return five consecutive scans that see a position of the lane, as the paper's Fig. 4 shows.

    Parameters
    ----------
    scans : (n,) ndarray of int
        Numbers of the scans that have an image.
    poses : (scan, 6) ndarray
        Poses of all scans.
    y : float
        Position along the lane, m.
    middle : float
        Distance ahead at which the third scan is to have the position, that of the image's middle,
        m.
    """
    ahead = y - poses[scans, 1]
    nearest = int(np.argmin(np.abs(ahead - middle)))
    first = max(0, min(nearest - _CONSECUTIVE // 2, len(scans) - _CONSECUTIVE))
    return [int(scan) for scan in scans[first : first + _CONSECUTIVE]]


def _patches(imaged: ImagedRun, place: FloatArray) -> tuple[Float32Array, AnyArray]:
    """Return the patches about a position in all scans that see it, and their distances ahead, m.

    Patches are magnitudes (scan, polarization, subband, y, x), ordered from near to far.
    """
    grid = imaged.near
    offsets = imaged.recipe.contrast.patch().offsets()
    poses = imaged.imager.run["pose"].values
    patches = []
    distances = []
    for index, scan in enumerate(imaged.imager.scans):
        position = lane_to_scan(place, poses[scan])[:2]
        if not grid.y_min <= position[1] <= imaged.recipe.run_view.y_max:
            continue
        image = imaged.near_imager.image(int(scan)).values
        magnitude = imaged.background.magnitude(image, imaged.gains[index])
        row = (position[1] + offsets[..., 1] - grid.y_min) / grid.dy
        column = (position[0] + offsets[..., 0] - grid.x_min) / grid.dx
        patches.append(bilinear(magnitude, row, column))
        distances.append(position[1])
    order = np.argsort(distances)
    return np.stack(patches)[order].astype(np.float32), np.asarray(distances)[order]
