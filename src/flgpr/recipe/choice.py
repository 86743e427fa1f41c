"""The figures of a recipe that follow from a run, and the reason for each."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from flgpr.model import SPEED_OF_LIGHT, scan_to_lane, unambiguous_path
from flgpr.recipe.radar_setup import (
    FEWEST_SCANS,
    SCAN_SPACING,
    Band,
    FloatArray,
    RadarSetup,
    allow_features,
)
from flgpr.recipe.schema import Recipe

# Lengths that belong to a mine and what surrounds it, whatever the array: Wang et al. 2007, m.
ALARM_RADIUS = 0.75
"""Radius of an alarm, m (Wang et al. 2007)."""
PATCH = 2.5
"""Length of the patch about an alarm, m (Wang et al. 2007)."""
MEAN = 2.55
"""Window of the background's mean, m (Wang et al. 2007)."""
MEDIAN_STEP = 0.15
"""Distance between the pixels of the background's median, m (Wang et al. 2007)."""
_HALF_VIEW = 3.0  # half width of the run-view, m
_NEAR = 1.2  # antenna heights ahead at which images begin: incidence of 50 degrees
_BANDWIDTH = 0.6e9  # Hz, whose range cell, 25 cm, is about a mine
_OVERLAP = 1 / 6  # share of a sub-band that the next one has, too
# Antenna heights ahead at which looks end: incidence of 76 degrees.
_FAR = 4.0
_FAR_APERTURE = 8.0  # the same for a synthetic aperture, which is as wide as what it looks at
_SPACINGS = (0.01, 0.02, 0.025, 0.03, 0.04, 0.05, 0.1)  # of pixels, m
_PIXEL = 2 / 3  # of a resolution cell, as in the paper's images
_GAP = 20  # usual steps without a tone that divide two bands


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


@dataclass(frozen=True)
class Figures:
    """What of a recipe follows from a run; distances as in the recipe."""

    described: str  #: what the recipe was made from
    fitted_to: str  #: the same in a few words
    aperture: bool  #: whether all scans are one synthetic aperture
    drives: bool  #: whether the mean scan is the self-signature
    polarizations: list[str]  #: those that the run has
    has_features: bool  #: whether the polarizations allow the ten features
    image_x: Band  #: borders of the images across, m in the scan frame
    image_y: Band  #: borders of the images ahead, m in the scan frame
    fine: float  #: spacing of the images, m
    window: str  #: that of the images
    bands: dict[str, Band]  #: sub-bands, Hz
    edges: dict[str, Band]  #: sub-bands as they are written, Hz
    median_step: int  #: pixels between those of the background's median
    view_x: Band  #: borders of the run-view across, m in the lane frame
    coarse: float  #: spacing of the run-view, m
    y_max: float  #: how far ahead looks count, m in the scan frame
    polarization: str  #: that of the prescreener
    subband: str  #: that of the prescreener
    reasons: dict[str, str]  #: the reason for each entry, by table and entry


@dataclass(frozen=True)
class _Method:
    """What the figures depend on beside the run."""

    window: str  #: that of the images
    patch: float = PATCH  #: length of the patch about an alarm, m
    mean: float = MEAN  #: window of the background's mean, m
    bands: dict[str, Band] | None = None  #: sub-bands, Hz; None divides the run's band
    subband: str = ""  #: the sub-band that limits the looks; "" goes by the run


def figures_of(setup: RadarSetup, model: Recipe | None = None) -> Figures:
    """Return what of the recipe of a run follows from the run, with the reason for each entry.

    Parameters
    ----------
    setup : RadarSetup
        Channels, tones, array and course of the run.
    model : Recipe, optional
        Recipe whose method the recipe has; without one it is that of Wang et al. 2007.

    Raises
    ------
    ValueError
        If the antennas are not above the ground, or the tones are too few or too far apart to make
        an image.
    """
    window = _window_of(setup, model)
    if model is None:
        choice = _choose(setup, _Method(window))
    else:
        choice = _choose_like(setup, model, window)
    return Figures(
        described=_described(setup),
        fitted_to=_fitted_to(setup),
        aperture=setup.aperture,
        drives=setup.drives,
        polarizations=setup.polarizations,
        has_features=allow_features(setup.polarizations),
        image_x=_image_x(choice),
        image_y=_image_y(setup, choice),
        fine=choice.fine,
        window=window,
        bands=choice.bands,
        edges=_edges(setup, choice),
        median_step=_median_step(choice),
        view_x=_view_x(setup, choice),
        coarse=choice.coarse,
        y_max=_last_look(setup, choice),
        polarization=_polarization_of(setup.polarizations),
        subband=choice.subband,
        reasons=_reasons_for(setup, choice),
    )


def _window_of(setup: RadarSetup, model: Recipe | None) -> str:
    """Return the window of the images: one of low sidelobes where no self-signature is subtracted.

    A model recipe whose window has low sidelobes hands its own on.
    """
    if model is not None and model.image.window != "boxcar":
        return model.image.window
    return "boxcar" if setup.drives else "hann"


def _choose_like(setup: RadarSetup, model: Recipe, window: str) -> _Choice:
    """Choose the figures for a model's method: as many sub-bands as leave the images clear."""
    method = _Method(
        window, patch=model.contrast.size * model.contrast.spacing, mean=model.background.mean
    )
    if model.map is None:
        return _choose(setup, method)
    bands = model.image.subbands
    for count in range(len(bands), 1, -1):
        try:
            return _choose(setup, _with_bands(method, setup, bands, count))
        except ValueError:
            continue  # fewer sub-bands are wider and have more tones
    return _choose(setup, _with_bands(method, setup, bands, 1))


def _choose(setup: RadarSetup, method: _Method) -> _Choice:
    """Choose the figures of a recipe; a ValueError if the run allows no image."""
    height = setup.height
    if not height >= 0.05:
        raise ValueError(
            f"run.pose must put the antennas at least 0.05 m above the ground, got {height:.3g} m"
        )
    # The main lobe of a Hann window is twice as wide.
    blur = 1 if method.window == "boxcar" else 2
    bands = method.bands or _divide(setup.tones, blur * _BANDWIDTH)
    nearest = _NEAR * height
    middle = 2 * _NEAR * height
    subband = method.subband or _prescreener_band(setup, bands, middle)
    band = bands[subband]

    half = min(max(nearest, _HALF_VIEW), 2 * _HALF_VIEW)
    if setup.aperture:
        half = float(np.ptp(setup.tx[:, 0])) / 2 + max(nearest, _HALF_VIEW) + PATCH / 2
    reach = min(_most_heights(setup) * height, max(_resolving_reach(setup, band), middle))
    # Patches of the features and windows of the background reach beyond the last look.
    wanted_end = reach + (method.patch + method.mean) / 2
    far = _clear_end(setup, list(bands.values()), half, middle, wanted_end)
    reach = min(reach, max(far - method.patch / 2, middle))

    widest = max(high - low for low, high in bands.values())
    range_cell = blur * SPEED_OF_LIGHT / (2 * widest)
    fine = min(range_cell, _cross_range(setup, float(setup.tones[-1]), nearest))
    range_cell = blur * SPEED_OF_LIGHT / (2 * (band[1] - band[0]))
    middle_of_band = (band[0] + band[1]) / 2
    coarse = min(range_cell, _cross_range(setup, middle_of_band, (nearest + reach) / 2))
    return _Choice(bands, subband, half, reach, far, _spacing(fine, 0.05), _spacing(coarse, 0.1))


def _most_heights(setup: RadarSetup) -> float:
    """Return the antenna heights ahead at which looks end at last."""
    return _FAR_APERTURE if setup.aperture else _FAR


def _cross_range(setup: RadarSetup, frequency: float, distance: float) -> float:
    """Return the cross-range resolution λR/(D_t + D_r), m.

    Parameters
    ----------
    setup : RadarSetup
        The array.
    frequency : float
        Hz.
    distance : float
        Ground range ahead of the antennas, m.
    """
    aperture = max(float(np.ptp((setup.tx + setup.rx)[:, 0])), 0.05)
    return SPEED_OF_LIGHT / frequency * math.hypot(distance, setup.height) / aperture


def _resolving_reach(setup: RadarSetup, band: Band) -> float:
    """Return how far ahead a band resolves an alarm's radius across, m."""
    slant = ALARM_RADIUS / _cross_range(setup, sum(band) / 2, 0.0) * setup.height
    return math.sqrt(max(slant**2 - setup.height**2, 0.0))


def _prescreener_band(setup: RadarSetup, bands: dict[str, Band], distance: float) -> str:
    """Return the lowest sub-band that resolves an alarm's radius at a distance, else the last."""
    names = [name for name in bands if name != "F0"]
    for name in names:
        if _resolving_reach(setup, bands[name]) >= distance:
            return name
    return names[-1]


def _pieces_of(tones: FloatArray) -> list[FloatArray]:
    """Return the tones, Hz, in the pieces that gaps make of them; lone tones are no piece.

    Raises
    ------
    ValueError
        If no two tones are neighbours.
    """
    steps = np.diff(tones)
    pieces = []
    if steps.size:
        gaps = np.flatnonzero(steps > _GAP * np.median(steps))
        pieces = [piece for piece in np.split(tones, gaps + 1) if piece.size > 1]
    if not pieces:
        raise ValueError(
            f"run.frequency must hold neighbouring tones, which make a band, got {tones.size} tone"
        )
    return pieces


def _divide(tones: FloatArray, least: float) -> dict[str, Band]:
    """Divide a band, or what gaps make of it, into equal sub-bands that overlap.

    They are as many as are at least so many Hz wide.
    """
    pieces = _pieces_of(tones)
    subbands: list[Band] = []
    for piece in pieces:
        low = float(piece[0])
        bandwidth = float(np.ptp(piece))
        count = max(int((bandwidth / least - _OVERLAP) / (1 - _OVERLAP)), 1)
        width = bandwidth / (count - (count - 1) * _OVERLAP)
        for number in range(count):
            start = low + number * width * (1 - _OVERLAP)
            subbands.append((start, start + width))
    bands = {}
    if pieces[0].size == tones.size and len(subbands) > 1:
        bands["F0"] = (float(tones[0]), float(tones[-1]))
    for number, subband in enumerate(subbands, 1):
        bands[f"F{number}"] = subband
    return bands


def _with_bands(
    method: _Method, setup: RadarSetup, model: Mapping[str, Band], count: int
) -> _Method:
    """Return a method with at most so many low sub-bands, of which the last limits the looks."""
    bands = _low_bands(setup.tones, model, count)
    return replace(method, bands=bands, subband=list(bands)[-1])


def _low_bands(tones: FloatArray, model: Mapping[str, Band], count: int) -> dict[str, Band]:
    """Return the model's sub-bands if a run's band holds them, else the lowest of the run.

    These lie side by side, at most ``count``, none narrower than the model's narrowest. Their
    lower and their upper end are as many octaves apart as the model's, or as the tones reach.
    """
    if count == len(model) and all(_holds(tones, band) for band in model.values()):
        return dict(model)
    lowest = min(low for low, _ in model.values())
    highest = max(high for _, high in model.values())
    narrowest = min(high - low for low, high in model.values())
    piece = _pieces_of(tones)[0]
    low = float(piece[0])
    if piece[-1] > lowest:
        low = max(low, lowest)
    high = min(low * highest / lowest, float(piece[-1]))
    if np.count_nonzero((piece >= low) & (piece <= high)) < 2:
        low, high = float(piece[0]), float(piece[-1])
    count = max(min(count, int((high - low) / narrowest)), 1)
    edges = np.geomspace(low, high, count + 1)
    edges[0], edges[-1] = low, high
    names = list(model)[:count]
    return {name: (float(edges[k]), float(edges[k + 1])) for k, name in enumerate(names)}


def _holds(tones: FloatArray, band: Band) -> bool:
    """Return whether a run's band, in one piece, holds a sub-band."""
    low, high = band
    return any(piece[0] <= low and high <= piece[-1] for piece in _pieces_of(tones))


def _clear_end(
    setup: RadarSetup, bands: Sequence[Band], half: float, least: float, farthest: float
) -> float:
    """Return the distance wanted ahead, or the farthest that the steps of the tones tell apart.

    Less than the ``least`` is a ValueError.
    """
    inside = [setup.tones[(setup.tones >= low) & (setup.tones <= high)] for low, high in bands]
    fewest = min(tones.size for tones in inside)
    if fewest < 2:
        raise ValueError(
            f"run.frequency must have two tones or more in every sub-band, got {fewest} in one"
        )
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


def _edges(setup: RadarSetup, choice: _Choice) -> dict[str, Band]:
    """Return the sub-bands as a recipe writes them, Hz: edges that are no tone to six digits."""
    edges = {}
    for name, (low, high) in choice.bands.items():
        edges[name] = (_edge(setup, low), _edge(setup, high))
    return edges


def _edge(setup: RadarSetup, edge: float) -> float:
    return float(edge) if edge in setup.tones else float(f"{edge:.6g}")


def pixels_of(lengths: Sequence[float], spacing: float) -> list[int]:
    """Return lengths (m) in odd numbers of pixels."""
    return [2 * round((length / spacing - 1) / 2) + 1 for length in lengths]


def _median_step(choice: _Choice) -> int:
    """Return the distance between the pixels of the background's median, in pixels."""
    return max(round(MEDIAN_STEP / choice.fine), 1)


def _rounded(distance: float) -> float:
    """Round a distance to 5 cm."""
    return round(20 * distance) / 20


def _image_x(choice: _Choice) -> Band:
    """Return the borders of the images across, m in the scan frame."""
    half = round(choice.half, 2)
    return -half, half


def _image_y(setup: RadarSetup, choice: _Choice) -> Band:
    """Return the borders of the images ahead, m in the scan frame."""
    return _rounded(setup.ahead + _NEAR * setup.height), _rounded(setup.ahead + choice.far)


def _last_look(setup: RadarSetup, choice: _Choice) -> float:
    """Return how far ahead looks count, m in the scan frame."""
    return _rounded(setup.ahead + choice.reach)


def _view_x(setup: RadarSetup, choice: _Choice) -> Band:
    """Return the borders of the run-view across, m in the lane frame."""
    x = float(np.median(setup.poses[:, 0]))
    left, right = x - _HALF_VIEW, x + _HALF_VIEW
    if setup.aperture:
        nearest, _ = _image_y(setup, choice)
        corners = []
        for side in (-choice.half, choice.half):
            for ahead in (nearest, _last_look(setup, choice)):
                corners.append((side, ahead, 0.0))
        covered = scan_to_lane(corners, setup.poses[0])[:, 0]
        left, right = float(covered.min()), float(covered.max())
    return round(left, 2), round(right, 2)


def _polarization_of(labels: Sequence[str]) -> str:
    """Return the polarization of the prescreener."""
    return next(label for label in ("HH", "VV", "HV", "VH") if label in labels)


def _described(setup: RadarSetup) -> str:
    """Return what a recipe was made from, a text of two lines of comment."""
    counts = f"{len(setup.poses)} complete scans and {len(setup.tx)} pairs"
    if setup.aperture:
        counts = f"{len(setup.tx)} places of antennas, one aperture"
    labels = ", ".join(setup.polarizations)
    return (
        f"from a run of {counts}, {labels}, {_band_text(setup)} in steps of\n"
        f"# {setup.step / 1e6:.4g} MHz, antennas {setup.height:.2f} m high."
    )


def _fitted_to(setup: RadarSetup) -> str:
    """Return what a recipe is fitted to, in a few words."""
    labels = ", ".join(setup.polarizations)
    return f"fitted to {labels}, {_band_text(setup)}, antennas {setup.height:.2f} m high"


def _band_text(setup: RadarSetup) -> str:
    return f"{setup.tones[0] / 1e9:.6g} to {setup.tones[-1] / 1e9:.6g} GHz"


def _reasons_for(setup: RadarSetup, choice: _Choice) -> dict[str, str]:
    """Return the reason for each entry that follows from the run, by table and entry."""
    sides = f"{_NEAR} antenna heights to either side, but {_HALF_VIEW:g} to {2 * _HALF_VIEW:g} m"
    extent = f"{_HALF_VIEW:g} m to either side of the vehicle's course"
    if setup.aperture:
        sides = (
            f"half the way across, and {_HALF_VIEW:g} m or {_NEAR} antenna heights and half a "
            "patch to either side of it"
        )
        extent = "what the image covers"
    window = "its low sidelobes keep the direct coupling out, for no self-signature is subtracted"
    signature = (
        f"the mean of fewer than {FEWEST_SCANS} scans {SCAN_SPACING:g} m apart holds the targets"
    )
    if setup.drives:
        window = (
            "as in Wang et al. 2007: subtracting the self-signature removes the direct coupling"
        )
        signature = "the vehicle drives on, so the mean scan holds little of any target"
    return {
        "image.x": sides,
        "image.y": (
            f"from {_NEAR} antenna heights ahead (incidence 50 degrees) to what y_max needs "
            "around it"
        ),
        "image.spacing": "two thirds of the finest resolution, but 0.01 to 0.05 m",
        "image.window": window,
        "image.subbands": (
            "equal parts of the run's band, as many as keep a range cell of 25 cm; F0 is all of it"
        ),
        "image.frames": (
            "the radar moves across what it looks at: all scans are one synthetic aperture"
        ),
        "background.self_signature": signature,
        "run_view.x": f"{extent}; it is as long as the lane",
        "run_view.spacing": (
            f"two thirds of the resolution that {choice.subband} has in the middle, but 0.01 to "
            "0.1 m"
        ),
        "run_view.y_max": (
            f"{_most_heights(setup):g} antenna heights, or as far as {choice.subband} resolves "
            f"{ALARM_RADIUS} m across"
        ),
        "prescreen.polarization": "co-polarized if the run has it, HH before VV",
        "prescreen.subband": (
            f"the lowest part that resolves {ALARM_RADIUS} m across, {2 * _NEAR:g} antenna heights "
            "ahead"
        ),
    }
