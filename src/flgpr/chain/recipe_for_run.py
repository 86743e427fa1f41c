"""A recipe made from a run: its figures follow from band, polarizations, array and course."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import xarray as xr

from flgpr.chain.recipe import parse_recipe
from flgpr.chain.recipe_fit import (
    ALARM_RADIUS,
    FEWEST_SCANS,
    SCAN_SPACING,
    Band,
    FloatArray,
    RadarSetup,
    allow_features,
    radar_setup,
)
from flgpr.model import (
    SPEED_OF_LIGHT,
    aperture_pose,
    aperture_run,
    complete_scans,
    lane_to_scan,
    scan_to_lane,
    unambiguous_path,
)
from flgpr.model.motion import plausible_run
from flgpr.store import MAX_MEMORY, open_run
from flgpr.store.files import faults_of
from flgpr.store.outputs import write_new

# Lengths that belong to a mine and what surrounds it, whatever the array: Wang et al. 2007, m.
_DENSITY = 0.75  # alarms per area of an alarm
_HALO = 1.0
_PATCH = 2.5
_INNER = (0.5, 0.3)
_GUARD = (0.9, 0.7)
_COHERENT = (0.25, 0.15)
_MEDIAN = 1.05
_MEAN = 2.55
_MEDIAN_STEP = 0.15
_BANDWIDTH = 0.6e9  # Hz, whose range cell, 25 cm, is about a mine
_OVERLAP = 1 / 6  # share of a sub-band that the next one has, too
_HALF_VIEW = 3.0  # half width of the run-view, m
# Antenna heights ahead at which images begin and looks end: incidence of 50 and 76 degrees.
_NEAR = 1.2
_FAR = 4.0
_FAR_APERTURE = 8.0  # the same for a synthetic aperture, which is as wide as what it looks at
_SPACINGS = (0.01, 0.02, 0.025, 0.03, 0.04, 0.05, 0.1)  # of pixels, m
_PIXEL = 2 / 3  # of a resolution cell, as in the paper's images
_GAP = 20  # usual steps without a tone that divide two bands
_ALIKE = 0.95  # length of the mean of the headings' unit vectors of a radar that looks one way
# m, and array widths, that a radar goes across its course at least to be a synthetic aperture
_ACROSS = (0.5, 2.0)
_PAPER = "as in Wang et al. 2007"


def recipe_for(
    run: str | Path, output: str | Path | None = None, max_memory: int = MAX_MEMORY
) -> str:
    """Make a recipe for a stored run, see :func:`fit_recipe`.

    Parameters
    ----------
    run : str or path
        Run store.
    output : str or path, optional
        File to write the recipe to.
    max_memory : int
        Bytes that reading the run may take.

    Returns
    -------
    str
        TOML of the recipe.

    Raises
    ------
    FileExistsError
        If another file is there.
    ValueError
        As of :func:`fit_recipe`.
    """
    dataset = open_run(run, max_memory)
    with faults_of(run):
        text = fit_recipe(dataset)
    if output is not None:
        write_new(Path(output), text)
    return text


def fit_recipe(run: xr.Dataset, begins: bool = False) -> str:
    """Make a recipe from what a run is: its band, polarizations, array and course.

    Lengths that belong to a mine are those of Wang et al. 2007; the rest follows from the run, and
    a comment beside every entry says how. The same run gives the same text. The recipe has the
    table features where the run has HH, VV and HV or VH, and no lane: a detection searches the
    ground that the run sees. A radar that moves past what it looks at, farther than twice its
    array's width, gets an image over the whole run (``frames = "all"``).

    Parameters
    ----------
    run : xarray.Dataset
        A run.
    begins : bool
        Whether the scans are the beginning of a drive that goes on. Its recipe takes the mean of
        many scans as self-signature.

    Returns
    -------
    str
        TOML of the recipe.

    Raises
    ------
    ValueError
        If the run has no complete scan or no height, or its tones are too few or too far apart to
        make an image.

    Examples
    --------
    >>> from flgpr.store import open_run, sample_lane
    >>> from flgpr.chain.recipe_for_run import fit_recipe
    >>> from flgpr.chain.recipe import parse_recipe
    >>> recipe = parse_recipe(fit_recipe(open_run(sample_lane() / "run.zarr")))
    >>> recipe.image.y, recipe.prescreen.polarization, list(recipe.image.subbands)
    ((1.8, 8.45), 'HH', ['F1'])
    """
    run = plausible_run(run)
    aperture = _goes_across(run)
    setup = radar_setup(aperture_run(run) if aperture else run, aperture)
    setup = replace(setup, begins=begins)
    text = _text(setup, _choose(setup))
    parse_recipe(text, "fitted")
    return text


def _goes_across(run: xr.Dataset) -> bool:
    """Return whether a radar moves past what it looks at, much farther than its array is wide."""
    pose = run["pose"].values[complete_scans(run)]
    if not len(pose):
        return False
    if abs(np.exp(1j * pose[:, 3]).mean()) < _ALIKE:  # there and back
        return False
    across, ahead = np.ptp(lane_to_scan(pose[:, :3], aperture_pose(run)), axis=0)[:2]
    widths = [float(np.ptp(run[f"{end}_position"].values[:, 0])) for end in ("tx", "rx")]
    least = max(_ACROSS[0], _ACROSS[1] * max(widths))
    return bool(across > least and across > 2 * ahead)


@dataclass(frozen=True)
class _Choice:
    """The figures of a recipe; distances count from the middle of the antennas."""

    bands: dict[str, Band]  #: sub-bands, Hz
    subband: str  #: that of the prescreener
    half: float  #: half width of the images, m
    reach: float  #: distance ahead up to which looks count, m
    far: float  #: distance ahead at which images end, m
    fine: float  #: spacing of the images, m
    coarse: float  #: spacing of the run-view, m


def _choose(setup: RadarSetup) -> _Choice:
    """Choose the figures of a recipe."""
    height = setup.height
    if not height >= 0.05:
        raise ValueError(
            f"run.pose must put the antennas at least 0.05 m above the ground, got {height:.3g} m"
        )
    blur = 1 if setup.drives else 2  # the main lobe of a Hann window is twice as wide
    bands = _divide(setup.tones, blur * _BANDWIDTH)
    nearest = _NEAR * height
    middle = 2 * _NEAR * height
    subband = _prescreener_band(setup, bands, middle)
    band = bands[subband]

    half = min(max(nearest, _HALF_VIEW), 2 * _HALF_VIEW)
    if setup.aperture:
        half = float(np.ptp(setup.tx[:, 0])) / 2 + max(nearest, _HALF_VIEW) + _PATCH / 2
    most_heights = _FAR_APERTURE if setup.aperture else _FAR
    reach = min(most_heights * height, max(setup.reach(band), middle))
    # Patches of the features and windows of the background reach beyond the last look.
    wanted_end = reach + (_PATCH + _MEAN) / 2
    far = _clear_end(setup, list(bands.values()), half, middle, wanted_end)
    reach = min(reach, max(far - _PATCH / 2, middle))

    widest = max(high - low for low, high in bands.values())
    range_cell = blur * SPEED_OF_LIGHT / (2 * widest)
    fine = min(range_cell, setup.cross_range(float(setup.tones[-1]), nearest))
    range_cell = blur * SPEED_OF_LIGHT / (2 * (band[1] - band[0]))
    coarse = min(range_cell, setup.cross_range((band[0] + band[1]) / 2, (nearest + reach) / 2))
    return _Choice(bands, subband, half, reach, far, _spacing(fine, 0.05), _spacing(coarse, 0.1))


def _prescreener_band(setup: RadarSetup, bands: dict[str, Band], distance: float) -> str:
    """Return the lowest sub-band that resolves an alarm's radius at a distance, else the last."""
    names = [name for name in bands if name != "F0"]
    for name in names:
        if setup.reach(bands[name]) >= distance:
            return name
    return names[-1]


def _divide(tones: FloatArray, least: float) -> dict[str, Band]:
    """Divide a band, or what gaps make of it, into equal sub-bands that overlap.

    They are as many as are at least so many Hz wide.
    """
    steps = np.diff(tones)
    pieces = []
    if steps.size:
        gaps = np.flatnonzero(steps > _GAP * np.median(steps))
        pieces = np.split(tones, gaps + 1)
    subbands: list[Band] = []
    for piece in pieces:
        low = float(piece[0])
        bandwidth = float(np.ptp(piece))
        if not bandwidth > 0:
            continue
        count = max(int((bandwidth / least - _OVERLAP) / (1 - _OVERLAP)), 1)
        width = bandwidth / (count - (count - 1) * _OVERLAP)
        for number in range(count):
            start = low + number * width * (1 - _OVERLAP)
            subbands.append((start, start + width))
    if not subbands:
        raise ValueError(
            f"run.frequency must hold neighbouring tones, which make a band, got {tones.size} tone"
        )
    bands = {}
    if len(pieces) == 1 and len(subbands) > 1:
        bands["F0"] = (float(tones[0]), float(tones[-1]))
    for number, subband in enumerate(subbands, 1):
        bands[f"F{number}"] = subband
    return bands


def _clear_end(
    setup: RadarSetup, bands: Sequence[Band], half: float, least: float, farthest: float
) -> float:
    """Return the distance wanted ahead, or the farthest that the steps of the tones tell apart.

    Less than the ``least`` is a ValueError.
    """
    inside = [setup.tones[(setup.tones >= low) & (setup.tones <= high)] for low, high in bands]
    cell = SPEED_OF_LIGHT / min(float(np.ptp(tones)) for tones in inside)
    longest = (min(unambiguous_path(tones) for tones in inside) - cell) / 2
    ends = np.concatenate([setup.tx, setup.rx])
    back = setup.ahead - ends[:, 1].min()
    side = half + np.abs(ends[:, 0]).max()
    up = ends[:, 2].max()
    far = math.sqrt(max(longest**2 - side**2 - up**2, 0.0)) - back - 0.1  # borders are rounded
    if far < least:
        widest = SPEED_OF_LIGHT / (2 * math.hypot(least + back + 0.1, side, up) + cell)
        raise ValueError(
            f"run.frequency must have tones at most {widest / 1e6:.3g} MHz apart for antennas "
            f"{setup.height:.3g} m high, got {setup.step / 1e6:.4g} MHz"
        )
    return min(farthest, far)


def _spacing(cell: float, most: float) -> float:
    """Return the spacing of pixels, m, that is nearest to two thirds of a resolution cell."""

    def off(spacing: float) -> float:
        return abs(spacing - _PIXEL * cell)

    return min((spacing for spacing in _SPACINGS if spacing <= most), key=off)


def _pixels(lengths: Sequence[float], spacing: float) -> list[int]:
    """Return lengths (m) in odd numbers of pixels."""
    return [2 * round((length / spacing - 1) / 2) + 1 for length in lengths]


def _text(setup: RadarSetup, choice: _Choice) -> str:
    """Write a recipe, with the reason for every entry beside it."""
    nearest = _rounded(setup.ahead + _NEAR * setup.height)
    far = _rounded(setup.ahead + choice.far)
    reach = _rounded(setup.ahead + choice.reach)
    tables = [
        _head(setup),
        _image_table(setup, choice, nearest, far),
        _subbands_table(choice),
        _background_table(setup, choice),
        _run_view_table(setup, choice, nearest, reach),
        _prescreen_table(setup, choice),
        _contrast_table(setup, choice),
    ]
    if allow_features(setup.polarizations):
        tables.append(_features_table(choice))
    tables.append(_score_table())
    return "\n".join(tables)


def _rounded(distance: float) -> float:
    """Round a distance to 5 cm."""
    return round(20 * distance) / 20


def _polarization(setup: RadarSetup) -> str:
    """Return the polarization of the prescreener."""
    return next(label for label in ("HH", "VV", "HV", "VH") if label in setup.polarizations)


def _band_text(setup: RadarSetup) -> str:
    return f"{setup.tones[0] / 1e9:.6g} to {setup.tones[-1] / 1e9:.6g} GHz"


def _head(setup: RadarSetup) -> str:
    """Write what the recipe was made from, its name and its description."""
    counts = f"{len(setup.poses)} complete scans and {len(setup.tx)} pairs"
    if setup.aperture:
        counts = f"{len(setup.tx)} places of antennas, one aperture"
    labels = ", ".join(setup.polarizations)
    confidence = "Ten features" if allow_features(setup.polarizations) else "Local contrast"
    band = _band_text(setup)
    return f"""\
# Made by `flgpr recipe for` from a run of {counts}, {labels}, {band} in steps of
# {setup.step / 1e6:.4g} MHz, antennas {setup.height:.2f} m high. Lengths in m, frequencies in Hz.

name = "fitted"
description = "{confidence} after Wang et al. 2007, fitted to {labels}, {band}, \
antennas {setup.height:.2f} m high"
"""


def _image_table(setup: RadarSetup, choice: _Choice, nearest: float, far: float) -> str:
    """Write the table of the scan images."""
    sides = f"{_NEAR} antenna heights to either side, but {_HALF_VIEW:g} to {2 * _HALF_VIEW:g} m"
    frames = ""
    if setup.aperture:
        sides = (
            f"half the way across, and {_HALF_VIEW:g} m or {_NEAR} antenna heights and half a "
            "patch to either side of it"
        )
        frames = (
            'frames = "all"  # the radar moves across what it looks at: all scans are one '
            "synthetic aperture\n"
        )
    window = "hann"
    reason = "its low sidelobes keep the direct coupling out, for no self-signature is subtracted"
    if setup.drives:
        window = "boxcar"
        reason = f"{_PAPER}: subtracting the self-signature removes the direct coupling"
    return f"""\
[image]
x = [{-choice.half:.2f}, {choice.half:.2f}]  # {sides}
y = [{nearest:.2f}, {far:.2f}]  # from {_NEAR} antenna heights ahead (incidence 50 degrees) \
to what y_max needs around it
spacing = {choice.fine}  # two thirds of the finest resolution, but 0.01 to 0.05 m
window = "{window}"  # {reason}
{frames}"""


def _subbands_table(choice: _Choice) -> str:
    """Write the table of the sub-bands."""
    lines = [
        "[image.subbands]  # equal parts of the run's band, as many as keep a range cell of 25 cm; "
        "F0 is all of it\n"
    ]
    for name, (low, high) in choice.bands.items():
        lines.append(f"{name} = [{low / 1e9:.6g}e9, {high / 1e9:.6g}e9]\n")
    return "".join(lines)


def _background_table(setup: RadarSetup, choice: _Choice) -> str:
    """Write the table of self-signature and gain background."""
    method = "none"
    reason = (
        f"the mean of fewer than {FEWEST_SCANS} scans {SCAN_SPACING:g} m apart holds the targets"
    )
    if setup.drives:
        method = "mean"
        reason = "the vehicle drives on, so the mean scan holds little of any target"
    step = max(round(_MEDIAN_STEP / choice.fine), 1)
    return f"""\
[background]
self_signature = "{method}"  # {reason}
median = {_MEDIAN}  # {_PAPER}
mean = {_MEAN}  # {_PAPER}
median_step = {step}  # {_MEDIAN_STEP} m, {_PAPER}
"""


def _run_view_table(setup: RadarSetup, choice: _Choice, nearest: float, reach: float) -> str:
    """Write the table of the run-view."""
    x = float(np.median(setup.poses[:, 0]))
    left, right = x - _HALF_VIEW, x + _HALF_VIEW
    extent = f"{_HALF_VIEW:g} m to either side of the vehicle's course"
    heights = _FAR
    if setup.aperture:
        corners = []
        for side in (-choice.half, choice.half):
            for ahead in (nearest, reach):
                corners.append((side, ahead, 0.0))
        covered = scan_to_lane(corners, setup.poses[0])[:, 0]
        left, right = float(covered.min()), float(covered.max())
        extent = "what the image covers"
        heights = _FAR_APERTURE
    return f"""\
[run_view]
x = [{left:.2f}, {right:.2f}]  # {extent}; it is as long as the lane
spacing = {choice.coarse}  # two thirds of the resolution that {choice.subband} has in the middle, \
but 0.01 to 0.1 m
y_max = {reach:.2f}  # {heights:g} antenna heights, or as far as {choice.subband} resolves \
{ALARM_RADIUS} m across
"""


def _prescreen_table(setup: RadarSetup, choice: _Choice) -> str:
    """Write the table of the prescreener."""
    return f"""\
[prescreen]
polarization = "{_polarization(setup)}"  # co-polarized if the run has it, HH before VV
subband = "{choice.subband}"  # the lowest part that resolves {ALARM_RADIUS} m across, \
{2 * _NEAR:g} antenna heights ahead
radius = {ALARM_RADIUS}  # {_PAPER}
density = {_DENSITY}  # {_PAPER}
count = "view"
"""


def _contrast_table(setup: RadarSetup, choice: _Choice) -> str:
    """Write the table of the local contrast."""
    spacing = choice.coarse
    return f"""\
[contrast]
polarization = "{_polarization(setup)}"  # the prescreener's channel
subband = "{choice.subband}"
size = {_pixels([_PATCH], spacing)[0]}  # {_PATCH} m, {_PAPER}
spacing = {spacing}  # the run-view's
inner = {_pixels(_INNER, spacing)}  # {_INNER[0]} m x {_INNER[1]} m, {_PAPER}
guard = {_pixels(_GUARD, spacing)}  # {_GUARD[0]} m x {_GUARD[1]} m, {_PAPER}
"""


def _features_table(choice: _Choice) -> str:
    """Write the table of the features."""
    return f"""\
[features]  # the run has HH, VV and a cross-polarized channel
inner = {_pixels(_COHERENT, choice.fine)}  # {_COHERENT[0]} m x {_COHERENT[1]} m of the image, \
{_PAPER}
psi = "circular"  # angles are averaged as directions
"""


def _score_table() -> str:
    """Write the table of the scoring."""
    return f"""\
[score]
halo = {_HALO}  # {_PAPER}
area = "union"
"""
