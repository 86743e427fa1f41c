"""Recipes and runs: a recipe made from a run, and whether a recipe fits one."""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from flgpr.chain.recipe import HALF_LANE, Recipe, as_imaged, lane_of, parse_recipe
from flgpr.model import (
    SPEED_OF_LIGHT,
    Lane,
    aperture_pose,
    aperture_run,
    clear_end,
    complete_scans,
    lane_to_scan,
    scan_to_lane,
    tightest_paths,
    unambiguous_path,
    vehicle_to_scan,
)
from flgpr.model.motion import plausible_run
from flgpr.store import MAX_MEMORY, open_run
from flgpr.store.outputs import write_new

FloatArray = NDArray[np.float64]
Band = tuple[float, float]

_HINT = "`flgpr recipe for RUN` writes one that fits"
# Lengths that belong to a mine and what surrounds it, whatever the array: Wang et al. 2007, m.
_RADIUS = 0.75
_DENSITY = 0.75
_HALO = 1.0
_PATCH = 2.5
_INNER = (0.5, 0.3)
_GUARD = (0.9, 0.7)
_COHERENT = (0.25, 0.15)
_MEDIAN = 1.05
_MEAN = 2.55
_MEDIAN_STEP = 0.15
# band whose range cell, 25 cm, is about a mine; part of it that the next band has too
_WIDTH = 0.6e9
_OVERLAP = 1 / 6
_VIEW = 3.0  # half width of the run-view, m
# antenna heights ahead: incidence of 50 and 76 degrees
_NEAR = 1.2
_FAR = 4.0
# scans, and m between them on average, from which on their mean holds little of a target
_SCANS = 5
_APART = 0.5
_SPACINGS = (0.01, 0.02, 0.025, 0.03, 0.04, 0.05, 0.1)
_PIXEL = 2 / 3  # of a resolution cell, as in the paper's images
_GAP = 20  # usual steps without a tone that divide two bands
_ALIKE = 0.95  # length of the mean of the headings' unit vectors of a radar that looks one way
_ACROSS = (
    0.5,
    2.0,
)  # m, and array widths, that a radar goes across its course at least to be a synthetic aperture
# antenna heights up to which such an aperture looks: it is as wide as what it looks at
_FAR_APERTURE = 8.0
_OUTSIDE = 0.1  # part of a sub-band that may lie outside the run's band
_HEIGHTS = (0.5, 3.5)  # antenna heights ahead at which an image may begin without a warning


@dataclass(frozen=True)
class _Setup:
    """What a recipe depends on: polarizations, tones (Hz), antennas in the scan frame (m), poses of complete scans."""

    polarizations: list[str]
    tones: FloatArray
    tx: FloatArray
    rx: FloatArray
    poses: FloatArray
    aperture: bool = False  #: whether the run is taken as one scan

    @property
    def height(self) -> float:
        return float((self.tx + self.rx)[:, 2].mean() / 2)

    @property
    def ahead(self) -> float:
        """How far the middle of the antennas lies ahead of the vehicle's reference point."""
        return float((self.tx + self.rx)[:, 1].mean() / 2)

    @property
    def step(self) -> float:
        return float(np.median(np.diff(self.tones))) if self.tones.size > 1 else 0.0

    @property
    def drives(self) -> bool:
        """Whether the mean scan is the self-signature rather than a blend of targets."""
        travelled = float(np.hypot(*np.diff(self.poses[:, :2], axis=0).T).sum())
        return len(self.poses) >= _SCANS and travelled >= _APART * (_SCANS - 1)

    def cross(self, frequency: float, distance: float) -> float:
        """Cross-range resolution λR/(D_t + D_r) at a distance ahead of the antennas."""
        aperture = max(float(np.ptp((self.tx + self.rx)[:, 0])), 0.05)
        return SPEED_OF_LIGHT / frequency * math.hypot(distance, self.height) / aperture

    def reach(self, band: Band) -> float:
        """Distance ahead of the antennas up to which a band's cross-range cell is no wider than an alarm's radius."""
        slant = _RADIUS / self.cross(sum(band) / 2, 0.0) * self.height
        return math.sqrt(max(slant**2 - self.height**2, 0.0))

    def behind(self, frames: int) -> float:
        """How far the vehicle drives while an image gathers its last scans: the earliest is so far behind, m."""
        earlier = self.poses[: 1 - frames or None, :2]
        later = self.poses[frames - 1 :, :2]
        return float(np.hypot(*(later - earlier).T).max()) if len(later) else 0.0


def _setup_of(run: xr.Dataset, aperture: bool = False) -> _Setup:
    poses = run["pose"].values[complete_scans(run)]
    if not len(poses):
        raise ValueError(
            f"run must have a scan without missing sweeps, got none among {run.sizes['scan']}"
        )
    tx, rx = (
        vehicle_to_scan(run[f"{end}_position"].values, np.median(poses, axis=0))
        for end in ("tx", "rx")
    )
    labels = [str(label) for label in run["polarization"].values]
    return _Setup(labels, run["frequency"].values, tx, rx, poses, aperture)


def _goes_across(run: xr.Dataset) -> bool:
    """Return whether a radar moves past what it looks at, much farther than its array is wide."""
    pose = run["pose"].values[complete_scans(run)]
    if not len(pose):
        return False
    if abs(np.exp(1j * pose[:, 3]).mean()) < _ALIKE:  # there and back
        return False
    across, ahead = np.ptp(lane_to_scan(pose[:, :3], aperture_pose(run)), axis=0)[:2]
    width = max(float(np.ptp(run[f"{end}_position"].values[:, 0])) for end in ("tx", "rx"))
    return bool(across > max(_ACROSS[0], _ACROSS[1] * width) and across > 2 * ahead)


def check_fit(run: xr.Dataset, recipe: Recipe) -> None:
    """Refuse a recipe that does not fit a run; warn where its image was meant for an array of another height.

    It must have the polarizations, no more than a tenth of a sub-band outside the run's band, and
    an image that does not show an echo twice for the steps of the tones. The ValueError names every
    entry at fault and what to do. An image that begins less than 0.5 or more than 3.5 antenna
    heights ahead is a UserWarning, and so is one in which echoes from before it appear again: the
    recording is what it is, and much of the image may still be good.
    """
    faults, doubts = fit_faults(run, recipe)
    _raise(faults)
    for one in doubts:
        warnings.warn(f"{one}; {_HINT}", stacklevel=2)


def fit_faults(run: xr.Dataset, recipe: Recipe) -> tuple[list[str], list[str]]:
    """Return what of a recipe does not fit a run, entry by entry, and what is doubtful; see :func:`check_fit`."""
    setup = _setup_of(as_imaged(run, recipe))
    image = recipe.image
    faults = _channel_faults(recipe, setup.polarizations, setup.tones)
    doubts = []
    fault, doubt = alias_faults(recipe, setup.tones, setup.tx, setup.rx, setup.behind(image.summed))
    faults += [fault] if fault else []
    doubts += [doubt] if doubt else []
    heights = (image.y[0] - setup.ahead) / setup.height if setup.height > 0 else math.inf
    if not _HEIGHTS[0] <= heights <= _HEIGHTS[1]:
        doubts.append(
            f"image.y should begin {_HEIGHTS[0]} to {_HEIGHTS[1]} antenna heights ahead of the "
            "antennas, got "
            f"{image.y[0]:g} m for antennas {setup.height:.3g} m high"
        )
    return faults, doubts


def alias_faults(
    recipe: Recipe, frequency: FloatArray, tx: FloatArray, rx: FloatArray, behind: float = 0.0
) -> tuple[str, str]:
    """Return why a recipe's image shows an echo twice, a fault, or echoes from before it, a doubt; "" if it does not.

    Antennas (pair, 3) are in the scan frame, m; the earliest scan that an image sums lies so far
    ``behind`` its own. Every sub-band counts by the tones (Hz) that it takes.
    """
    image = recipe.image
    ground = image.x, (image.y[0], image.y[1] + behind)
    paths = tightest_paths(frequency, image.subbands, tx, rx, *ground)
    if not (paths.repeats or paths.aliased):
        return "", ""
    seen = f"got {image.y[1]:g} m with one of {paths.farthest:.4g} m: for the steps of the tones echoes repeat after"
    end = clear_end(paths, tx, rx, *ground) - behind
    mend = f"end it at {math.floor(100 * end) / 100:g} m, or " if end > image.y[0] else ""
    mend += f"record with steps of at most {paths.widest_step / 1e6:.3g} MHz"
    if paths.repeats:
        return (
            "image.y must end where paths are shorter than "
            f"{paths.nearest + paths.unambiguous:.4g} m, {seen} "
            f"{paths.unambiguous:.4g} m of path, so the image shows what is near in it again where "
            f"it is far; {mend}"
        ), ""
    return "", (
        f"image.y should end where paths are shorter than {paths.longest_clear:.4g} m, {seen} "
        f"{paths.unambiguous:.4g} "
        "m of path, so the direct coupling and what lies under the vehicle appear in the image "
        f"again; {mend}"
    )


def area_of(run: xr.Dataset, recipe: Recipe, lane: Lane | None = None) -> Lane:
    """Check that a recipe fits a run, and choose the lane: that given, the recipe's, or the ground the scans cover."""
    check_fit(run, recipe)
    return lane if lane is not None else lane_of(run, recipe)


def check_channels(recipe: Recipe, polarizations: Sequence[str], tones: FloatArray) -> None:
    """Refuse a recipe that asks for polarizations or tones (Hz) that are not measured; see :func:`check_fit`."""
    _raise(_channel_faults(recipe, polarizations, tones))


def _raise(faults: list[str]) -> None:
    if faults:
        raise ValueError("; ".join([*faults, _HINT]))


def _channel_faults(recipe: Recipe, polarizations: Sequence[str], tones: FloatArray) -> list[str]:
    known = ", ".join(polarizations)
    faults = []
    wants = [("contrast.polarization", recipe.contrast.polarization)]
    if recipe.map is None:
        wants.insert(0, ("prescreen.polarization", recipe.prescreen.polarization))
    for name, wanted in [
        *wants,
        *(("image.polarizations", one) for one in recipe.image.polarizations),
    ]:
        if wanted not in polarizations:
            faults.append(f"{name} must be one the run has ({known}), got {wanted!r}")
    if recipe.features is not None and not _allow_features(polarizations):
        faults.append(
            f"features must be left out unless the run has HH, VV and HV or VH, got {known}"
        )
    for name, (low, high) in recipe.image.subbands.items():
        outside = max(tones[0] - low, 0.0) + max(high - tones[-1], 0.0)
        if outside > _OUTSIDE * (high - low) or not ((tones >= low) & (tones <= high)).any():
            faults.append(
                f"image.subbands.{name} must lie in the run's band, {tones[0] / 1e9:.4g} to "
                f"{tones[-1] / 1e9:.4g} GHz, "
                f"got {low / 1e9:.4g} to {high / 1e9:.4g} GHz"
            )
    return faults


def _allow_features(polarizations: Sequence[str]) -> bool:
    return {"HH", "VV"} <= set(polarizations) and bool({"HV", "VH"} & set(polarizations))


def recipe_for(
    run: str | Path, output: str | Path | None = None, max_memory: int = MAX_MEMORY
) -> str:
    """Make a recipe for a stored run, see :func:`fit_recipe`; write it if asked, where no other file is yet."""
    text = fit_recipe(open_run(run, max_memory))
    if output is not None:
        write_new(Path(output), text)
    return text


def fit_recipe(run: xr.Dataset) -> str:
    """Make a recipe from what a run is: its band, polarizations, array and course.

    Lengths that belong to a mine are those of Wang et al. 2007; the rest follows from the run, and
    a comment beside every entry says how. The same run gives the same text: with the table features
    where the run has HH, VV and HV or VH, with a lane where it is shorter than its images. A run
    without a complete scan or height, or with tones too few or too far apart to make an image, is a
    ValueError. A radar that moves past what it looks at, farther than twice its array's width, gets
    an image over the whole run (``frames = "all"``).

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
    across = _goes_across(run)
    setup = _setup_of(aperture_run(run) if across else run, across)
    text = _text(setup, _choose(setup))
    parse_recipe(text, "fitted")
    return text


@dataclass(frozen=True)
class _Choice:
    """The figures of a recipe, Hz and m; distances count from the middle of the antennas."""

    bands: dict[str, Band]
    subband: str
    half: float
    reach: float
    far: float
    fine: float
    coarse: float


def _choose(setup: _Setup) -> _Choice:
    height = setup.height
    if not height >= 0.05:
        raise ValueError(
            f"run.pose must put the antennas at least 0.05 m above the ground, got {height:.3g} m"
        )
    blur = 1 if setup.drives else 2  # the main lobe of a Hann window is twice as wide
    bands = _divide(setup.tones, blur * _WIDTH)
    near = _NEAR * height
    middle = 2 * _NEAR * height
    parts = [name for name in bands if name != "F0"]
    subband = next((name for name in parts if setup.reach(bands[name]) >= middle), parts[-1])
    half = min(max(near, _VIEW), 2 * _VIEW)
    if setup.aperture:
        half = float(np.ptp(setup.tx[:, 0])) / 2 + max(near, _VIEW) + _PATCH / 2
    reach = min(
        (_FAR_APERTURE if setup.aperture else _FAR) * height,
        max(setup.reach(bands[subband]), middle),
    )
    far = _clear(setup, list(bands.values()), half, middle, reach + (_PATCH + _MEAN) / 2)
    reach = min(reach, max(far - _PATCH / 2, middle))
    own = bands[subband]
    widest = max(high - low for low, high in bands.values())
    fine = min(blur * SPEED_OF_LIGHT / (2 * widest), setup.cross(float(setup.tones[-1]), near))
    coarse = min(
        blur * SPEED_OF_LIGHT / (2 * (own[1] - own[0])),
        setup.cross((own[0] + own[1]) / 2, (near + reach) / 2),
    )
    return _Choice(bands, subband, half, reach, far, _sensible(fine, 0.05), _sensible(coarse, 0.1))


def _divide(tones: FloatArray, least: float) -> dict[str, Band]:
    """Divide a band, or what gaps make of it, into the most equal parts of at least so many Hz that overlap."""
    steps = np.diff(tones)
    pieces = (
        np.split(tones, np.flatnonzero(steps > _GAP * np.median(steps)) + 1) if steps.size else []
    )
    parts: list[Band] = []
    for piece in pieces:
        low = float(piece[0])
        band = float(np.ptp(piece))
        count = max(int((band / least - _OVERLAP) / (1 - _OVERLAP)), 1)
        width = band / (count - (count - 1) * _OVERLAP)
        starts = [low + number * width * (1 - _OVERLAP) for number in range(count)]
        parts += [(start, start + width) for start in starts if band > 0]
    if not parts:
        raise ValueError(
            f"run.frequency must hold neighbouring tones, which make a band, got {tones.size} tone"
        )
    whole = (
        {"F0": (float(tones[0]), float(tones[-1]))} if len(pieces) == 1 and len(parts) > 1 else {}
    )
    return whole | {f"F{number}": part for number, part in enumerate(parts, 1)}


def _clear(setup: _Setup, bands: Sequence[Band], half: float, least: float, wanted: float) -> float:
    """Return the distance wanted ahead, or the farthest whose paths the steps of the tones tell apart."""
    inside = [setup.tones[(setup.tones >= low) & (setup.tones <= high)] for low, high in bands]
    cell = SPEED_OF_LIGHT / min(float(np.ptp(tones)) for tones in inside)
    longest = (min(unambiguous_path(tones) for tones in inside) - cell) / 2
    ends = np.concatenate([setup.tx, setup.rx])
    back = setup.ahead - ends[:, 1].min()
    side = half + np.abs(ends[:, 0]).max()
    up = ends[:, 2].max()
    far = math.sqrt(max(longest**2 - side**2 - up**2, 0.0)) - back - 0.1  # borders are rounded
    if far < least:
        apart = SPEED_OF_LIGHT / (2 * math.hypot(least + back + 0.1, side, up) + cell)
        raise ValueError(
            f"run.frequency must have tones at most {apart / 1e6:.3g} MHz apart for antennas "
            f"{setup.height:.3g} m "
            f"high, got {setup.step / 1e6:.4g} MHz"
        )
    return min(wanted, far)


def _sensible(cell: float, most: float) -> float:
    return min((one for one in _SPACINGS if one <= most), key=lambda one: abs(one - _PIXEL * cell))


def _pixels(lengths: Sequence[float], spacing: float) -> list[int]:
    return [2 * round((length / spacing - 1) / 2) + 1 for length in lengths]


def _text(setup: _Setup, choice: _Choice) -> str:
    """Write a recipe, and beside every entry where it comes from."""
    near, far, reach = (
        round(20 * (setup.ahead + y)) / 20 for y in (_NEAR * setup.height, choice.far, choice.reach)
    )
    features = _allow_features(setup.polarizations)
    labels = ", ".join(setup.polarizations)
    polarization = next(label for label in ("HH", "VV", "HV", "VH") if label in setup.polarizations)
    x = float(np.median(setup.poses[:, 0]))
    y = np.sort(setup.poses[:, 1])
    sides = f"{_NEAR} antenna heights to either side, but {_VIEW:g} to {2 * _VIEW:g} m"
    view = (x - _VIEW, x + _VIEW)
    beside = f"{_VIEW:g} m to either side of the vehicle's course"
    frames = ""
    heights = _FAR_APERTURE if setup.aperture else _FAR
    counts = f"{len(setup.poses)} complete scans and {len(setup.tx)} pairs"
    if setup.aperture:
        counts = f"{len(setup.tx)} places of antennas, one aperture"
        ground = [
            (side, ahead, 0.0) for side in (-choice.half, choice.half) for ahead in (near, reach)
        ]
        covered = scan_to_lane(ground, setup.poses[0])[:, 0]
        view = (float(covered.min()), float(covered.max()))
        beside = "what the image covers"
        sides = f"half the way across, and {_VIEW:g} m or {_NEAR} antenna heights and half a patch to either side of it"
        frames = '\nframes = "all"  # the radar moves across what it looks at: all scans are one synthetic aperture'
    band = f"{setup.tones[0] / 1e9:.6g} to {setup.tones[-1] / 1e9:.6g} GHz"
    fine = choice.fine
    coarse = choice.coarse
    paper = "as in Wang et al. 2007"
    bands = "\n".join(
        f"{name} = [{low / 1e9:.6g}e9, {high / 1e9:.6g}e9]"
        for name, (low, high) in choice.bands.items()
    )
    window = 'window = "hann"  # its low sidelobes keep the direct coupling out, for no self-signature is subtracted'
    few = f"the mean of fewer than {_SCANS} scans {_APART:g} m apart holds the targets"
    signature = f'self_signature = "none"  # {few}'
    if setup.drives:
        reason = (
            "as in Wang et al. 2007: subtracting the self-signature removes the direct coupling"
        )
        window = f'window = "boxcar"  # {reason}'
        signature = 'self_signature = "mean"  # the vehicle drives on, so the mean scan holds little of any target'
    more = ""
    if features:
        more += f"""
[features]  # the run has HH, VV and a cross-polarized channel
inner = {_pixels(_COHERENT, fine)}  # {_COHERENT[0]} m x {_COHERENT[1]} m of the image, {paper}
psi = "circular"  # angles are averaged as directions
"""
    if y[-1] - y[0] < reach - near and not setup.aperture:
        more += f"""
[lane]  # the run is shorter than its images, so ground ahead of its end is searched, too
x_min = {x - HALF_LANE:.2f}  # {HALF_LANE} m to either side of the vehicle's course
x_max = {x + HALF_LANE:.2f}
y_min = {y[0] + near:.2f}  # nearest row of the first scan's image
y_max = {y[-2:][0] + reach:.2f}  # run_view.y_max ahead of the last scan but one, so that two scans see it
"""
    return f"""# Made by `flgpr recipe for` from a run of {counts}, \
{labels}, {band} in steps of
# {setup.step / 1e6:.4g} MHz, antennas {setup.height:.2f} m high. Lengths in m, frequencies in Hz.

name = "fitted"
description = "{"Ten features" if features else "Local contrast"} after Wang et al. 2007, fitted to {labels}, {band}, \
antennas {setup.height:.2f} m high"

[image]
x = [{-choice.half:.2f}, {choice.half:.2f}]  # {sides}
y = [{near:.2f}, {far:.2f}]  # from {_NEAR} antenna heights ahead (incidence 50 degrees) to what y_max needs around it
spacing = {fine}  # two thirds of the finest resolution, but 0.01 to 0.05 m
{window}{frames}

[image.subbands]  # equal parts of the run's band, as many as keep a range cell of 25 cm; F0 is all of it
{bands}

[background]
{signature}
median = {_MEDIAN}  # {paper}
mean = {_MEAN}  # {paper}
median_step = {max(round(_MEDIAN_STEP / fine), 1)}  # {_MEDIAN_STEP} m, {paper}

[run_view]
x = [{view[0]:.2f}, {view[1]:.2f}]  # {beside}; it is as long as the lane
spacing = {coarse}  # two thirds of the resolution that {choice.subband} has in the middle, but 0.01 to 0.1 m
y_max = {reach:.2f}  # {heights:g} antenna heights, or as far as {choice.subband} resolves {_RADIUS} m across

[prescreen]
polarization = "{polarization}"  # co-polarized if the run has it, HH before VV
subband = "{choice.subband}"  # the lowest part that resolves {_RADIUS} m across, {2 * _NEAR:g} antenna heights ahead
radius = {_RADIUS}  # {paper}
density = {_DENSITY}  # {paper}
count = "view"

[contrast]
polarization = "{polarization}"  # the prescreener's channel
subband = "{choice.subband}"
size = {_pixels([_PATCH], coarse)[0]}  # {_PATCH} m, {paper}
spacing = {coarse}  # the run-view's
inner = {_pixels(_INNER, coarse)}  # {_INNER[0]} m x {_INNER[1]} m, {paper}
guard = {_pixels(_GUARD, coarse)}  # {_GUARD[0]} m x {_GUARD[1]} m, {paper}
{more}
[score]
halo = {_HALO}  # {paper}
area = "union"
"""
