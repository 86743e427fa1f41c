"""The figures of a recipe that follow from a run, and the reason for each."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from flgpr.model import (
    SPEED_OF_LIGHT,
    load_sensor,
    scan_to_lane,
    sensor_presets,
    unambiguous_path,
)
from flgpr.model.ambiguity import grating_clear
from flgpr.recipe.lengths import (
    PAPERS_HEIGHT,
    divide,
    divisions_like,
    length_at,
    pieces_of,
    reason_for,
)
from flgpr.recipe.radar_setup import (
    FEWEST_SCANS,
    SCAN_SPACING,
    Band,
    RadarSetup,
    allow_features,
)
from flgpr.recipe.schema import Recipe

# Lengths of the array of Wang et al. 2007, 5 m high, m.
_PAPERS = {"radius": 0.75, "patch": 2.5, "mean": 2.55}
_ALARM_RADIUS = 0.75  # m that a sub-band resolves across, so that it tells alarms apart
MEDIAN_STEP = 0.15
"""Distance between the pixels of the background's median, m (Wang et al. 2007)."""
_HALF_VIEW = 3.0  # half width of the run-view, m
# Half width of an image at least: a lane without borders of its own is 3 m wide, and more has to be
# seen beside it.
_LEAST_HALF = 1.8
_ASIDE = 1.2  # antenna heights to either side that images reach
_NEAR = 0.8  # antenna heights ahead at which images begin: incidence of 39 degrees
_NEAR_UNCLEAN = 1.2  # the same where nothing takes the ground's echo out: incidence of 50 degrees
_NEAR_AGAIN = 1.4  # the same where earlier drives predict the ground: incidence of 54 degrees
_MIDDLE = 2.4  # antenna heights ahead that looks reach at least: incidence of 67 degrees
_BANDWIDTH = 0.6e9  # Hz, whose range cell, 25 cm, is about a mine
# Antenna heights ahead at which looks end: incidence of 76 degrees.
_FAR = 4.0
_FAR_APERTURE = 8.0  # the same for a synthetic aperture, which is as wide as what it looks at
_SPACINGS = (0.01, 0.02, 0.025, 0.03, 0.04, 0.05, 0.1)  # of pixels, m
_PIXEL = 2 / 3  # of a resolution cell, as in the paper's images
_MAP_PIXEL = 1 / 4  # of the finest cell of a map's sub-bands: phases of neighbours are compared
_REASONS_AGAIN = {
    "image.window": "its low sidelobes keep apart what has changed and what has not",
    "image.subbands": (
        "all of the run's band, up to where grating lobes of the array come to 50 degrees: what they "
        "bring in is not predicted"
    ),
    "prescreen.polarization": "co-polarized if the run has it, VV before HH: it shows more of plastic",
    "prescreen.subband": "there is one sub-band",
}
_STEP = (0.1, 0.2)  # m, between the pixels of a chip: a third and two thirds of a mine
_STEP_UNIT = 0.05  # m, to which it is rounded


@dataclass(frozen=True)
class Figures:
    """What of a recipe follows from a run.

    ``half``, ``reach`` and ``far`` count from the middle of the antennas, and the properties as the
    recipe does: images in the scan frame, the run-view in the lane frame.
    """

    setup: RadarSetup  #: the run
    method: _Method  #: what it was chosen for
    bands: dict[str, Band]  #: sub-bands, Hz
    subband: str  #: that of the prescreener
    half: float  #: half width of the images, m
    reach: float  #: distance ahead up to which looks count, m
    far: float  #: distance ahead at which images end, m
    fine: float  #: spacing of the images, m
    coarse: float  #: spacing of the run-view, m
    whole: bool = False  #: whether the only sub-band is that of a model

    @property
    def has_features(self) -> bool:
        """Whether the polarizations allow the ten features, and alarms are ranked by one of them."""
        return allow_features(self.setup.polarizations) and not self.method.again

    @property
    def described(self) -> str:
        """What a recipe was made from, a text of two lines of comment."""
        counts = f"{len(self.setup.poses)} complete scans and {len(self.setup.tx)} pairs"
        if self.setup.aperture:
            counts = f"{len(self.setup.tx)} places of antennas, one aperture"
        labels = ", ".join(self.setup.polarizations)
        return (
            f"from a run of {counts}, {labels}, {self._band_text} in steps of\n"
            f"# {self.setup.step / 1e6:.4g} MHz, antennas {self.setup.height:.2f} m high."
        )

    @property
    def fitted_to(self) -> str:
        """What a recipe is fitted to, in a few words."""
        labels = ", ".join(self.setup.polarizations)
        return f"fitted to {labels}, {self._band_text}, antennas {self.setup.height:.2f} m high"

    @property
    def image_x(self) -> Band:
        """The borders of the images across, m in the scan frame."""
        half = round(self.half, 2)
        return -half, half

    @property
    def image_y(self) -> Band:
        """The borders of the images ahead, m in the scan frame."""
        nearest = self.method.near * self.setup.height
        return _rounded(self.setup.ahead + nearest), _rounded(self.setup.ahead + self.far)

    @property
    def edges(self) -> dict[str, Band]:
        """The sub-bands as a recipe writes them, Hz: edges that are no tone to six digits."""
        edges = {}
        for name, (low, high) in self.bands.items():
            edges[name] = (_edge(self.setup, low), _edge(self.setup, high))
        return edges

    @property
    def median_step(self) -> int:
        """The distance between the pixels of the background's median, in pixels."""
        return max(round(MEDIAN_STEP / self.fine), 1)

    @property
    def step(self) -> float:
        """The distance between the pixels of a chip, m: half a wavelength in the middle."""
        edges = [edge for band in self.bands.values() for edge in band]
        half_wave = SPEED_OF_LIGHT / (min(edges) + max(edges))
        least, most = _STEP
        step = _STEP_UNIT * round(min(max(half_wave, least), most) / _STEP_UNIT)
        return round(step, 2)

    @property
    def view_x(self) -> Band:
        """The borders of the run-view across, m in the lane frame."""
        x = float(np.median(self.setup.poses[:, 0]))
        half = min(_HALF_VIEW, self.half)
        left, right = x - half, x + half
        if self.setup.aperture:
            nearest, _ = self.image_y
            corners = []
            for side in (-self.half, self.half):
                for ahead in (nearest, self.y_max):
                    corners.append((side, ahead, 0.0))
            covered = scan_to_lane(corners, self.setup.poses[0])[:, 0]
            left, right = float(covered.min()), float(covered.max())
        return round(left, 2), round(right, 2)

    @property
    def y_max(self) -> float:
        """How far ahead looks count, m in the scan frame."""
        return _rounded(self.setup.ahead + self.reach)

    @property
    def polarization(self) -> str:
        """The polarization of the prescreener."""
        labels = ("VV", "HH", "HV", "VH") if self.method.again else ("HH", "VV", "HV", "VH")
        return next(label for label in labels if label in self.setup.polarizations)

    @property
    def reasons(self) -> dict[str, str]:
        """The reason for each entry that follows from the run, by table and entry."""
        reasons = self._image_reasons | self._view_reasons
        own = self.method.own
        for entry, name in _LENGTHS_OF.items():
            if entry in own:
                reasons[name] = "as in Wang et al. 2007"
                if not self.setup.aperture:
                    reasons[name] = reason_for(entry, own[entry], self.method.own_height)
        if self.method.model is not None:
            reasons |= self._map_reasons
        if self.whole:
            reasons["image.subbands"] = (
                "the model's band where the run has it, else all of the run's"
            )
        if self.whole or self.method.model is not None:
            reasons["image.spacing"] = (
                "a quarter of the finest resolution of its sub-bands, but 0.02 to 0.05 m"
            )
            reasons["run_view.spacing"] = (
                f"a quarter of the resolution that {self.subband} has in the middle, but 0.05 to "
                "0.1 m"
            )
        signature = f"the mean of fewer than {FEWEST_SCANS} scans {SCAN_SPACING:g} m apart holds the targets"
        if self.setup.drives:
            signature = "the vehicle drives on, so the mean scan holds little of any target"
        reasons["background.self_signature"] = signature
        reasons["clutter"] = (
            "no self-signature is taken, so what arrives before the first pixel is taken out: direct "
            "wave and ground under the antennas"
        )
        return reasons | _REASONS_AGAIN if self.method.again else reasons

    @property
    def _image_reasons(self) -> dict[str, str]:
        """The reason for each entry of the images."""
        sides = (
            f"{_ASIDE} antenna heights to either side, but {_LEAST_HALF:g} to {2 * _HALF_VIEW:g} m"
        )
        if self.setup.aperture:
            sides = (
                f"half the way across, and {_HALF_VIEW:g} m or {_ASIDE} antenna heights and half a "
                "patch to either side of it"
            )
        window = (
            "its low sidelobes keep the direct coupling out, for no self-signature is subtracted"
        )
        if self.setup.drives:
            window = (
                "as in Wang et al. 2007: subtracting the self-signature removes the direct coupling"
            )
        near = self.method.near
        incidence = round(math.degrees(math.atan(near)))
        begin = f"{near} antenna heights ahead (incidence {incidence} degrees)"
        if self.method.again:
            begin += f", not {_NEAR}: earlier drives predict less of what is nearer"
        elif near != _NEAR:
            begin += f", not {_NEAR}: nothing takes the ground's echo out"
        return {
            "image.x": sides,
            "image.y": f"from {begin} to what y_max needs around it",
            "image.spacing": "two thirds of the finest resolution, but 0.01 to 0.05 m",
            "image.window": window,
            "image.subbands": (
                "equal parts of the run's band, as many as keep a range cell of 25 cm; F0 is all of it"
            ),
            "image.frames": (
                "the radar moves across what it looks at: all scans are one synthetic aperture"
            ),
        }

    @property
    def _view_reasons(self) -> dict[str, str]:
        """The reason for each entry of the run-view and of the prescreener."""
        half = min(_HALF_VIEW, self.half)
        extent = f"{half:g} m to either side of the vehicle's course"
        count = "alarms are as dense in the lane, whatever lies beside it"
        if self.setup.aperture:
            extent = "what the image covers"
            count = "all that the image covers is searched"
        return {
            "run_view.x": f"{extent}; it is as long as the lane",
            "run_view.spacing": (
                f"two thirds of the resolution that {self.subband} has in the middle, but 0.01 to "
                "0.1 m"
            ),
            "run_view.y_max": (
                f"{_most_heights(self.setup):g} antenna heights, or as far as {self.subband} resolves "
                f"{_ALARM_RADIUS} m across"
            ),
            "prescreen.polarization": "co-polarized if the run has it, HH before VV",
            "prescreen.subband": (
                f"the lowest part that resolves {_ALARM_RADIUS} m across, {_MIDDLE:g} antenna heights "
                "ahead"
            ),
            "prescreen.count": count,
        }

    @property
    def _map_reasons(self) -> dict[str, str]:
        """The reason for each entry that is another one for a map."""
        gap = _gap(self.setup.height, self.method.near)
        ring = 2 * self.method.lengths["outer"]
        narrowest = min(high - low for low, high in self.bands.values())
        cell = SPEED_OF_LIGHT / narrowest
        longest = _longest_cell(self.setup, self.method)
        held = "shorter" if cell <= longest else "but not shorter, for want of band,"
        return {
            "image.subbands": (
                f"range cells of at most {cell:.2g} m, {held} than the gap in path from the ground's "
                f"echo to the first pixel, {gap:.2g} m, and than the contrast's ring, {ring:.2g} m"
            ),
            "map.step": (
                f"half a wavelength in the middle of its sub-bands, but {_STEP[0]:g} to {_STEP[1]:g} m"
            ),
        }

    @property
    def _band_text(self) -> str:
        return f"{self.setup.tones[0] / 1e9:.6g} to {self.setup.tones[-1] / 1e9:.6g} GHz"


@dataclass(frozen=True)
class _Method:
    """What the figures depend on beside the run."""

    window: str  #: that of the images
    early: bool  #: whether the stage "early" takes the ground's echo out
    near: float  #: antenna heights ahead at which images begin
    own: dict[str, float]  #: lengths of the method for its own array, m
    own_height: float  #: height of that array, m
    lengths: dict[str, float]  #: the same for the array of the run
    again: bool = False  #: whether earlier drives over the road tell what has changed
    #: recipe with a map of simulated signatures, whose sub-bands it has
    model: Recipe | None = None

    @property
    def beyond(self) -> float:
        """How far patches and windows reach beyond the last look, m."""
        return (self.lengths["patch"] + self.lengths["mean"]) / 2


def figures_of(setup: RadarSetup, model: Recipe | None = None, again: bool = False) -> Figures:
    """Return what of the recipe of a run follows from the run, with the reason for each entry.

    Parameters
    ----------
    setup : RadarSetup
        Channels, tones, array and course of the run.
    model : Recipe, optional
        Recipe whose method the recipe has; without one it is that of Wang et al. 2007.
    again : bool
        Whether earlier drives over the road tell what has changed; not with a model.

    Raises
    ------
    ValueError
        If the antennas are not above the ground, or the tones are too few or too far apart to make
        an image.
    """
    height = setup.height
    if not height >= 0.05:
        raise ValueError(
            f"run.pose must put the antennas at least 0.05 m above the ground, got {height:.3g} m: "
            "`flgpr image` focuses the section below antennas on it"
        )
    own, own_height = _own_lengths(model)
    lengths = {}
    for entry, length in own.items():
        lengths[entry] = length
        if not setup.aperture:  # which resolves by its own length, not by its height
            lengths[entry] = length_at(height, entry, length, own_height)
    resolves = SPEED_OF_LIGHT / max(
        float(np.ptp(piece)) for piece in pieces_of(setup.tones)
    ) < _gap(height, _NEAR)
    early = resolves and not setup.drives and not setup.aperture
    method = _Method(
        window="hann" if again else _window_of(setup, model),
        early=early,
        near=_NEAR_AGAIN if again else _NEAR if setup.drives or early else _NEAR_UNCLEAN,
        own=own,
        own_height=own_height,
        lengths=lengths,
        model=model if "outer" in own else None,
        again=again,
    )
    if method.model:
        return _choose_like(setup, method, method.model.image.subbands)
    if again:
        return _choose(setup, method, _band_again(setup))
    whole = _whole_band(setup, model)
    return replace(_choose(setup, method, whole), whole=whole is not None)


def _whole_band(setup: RadarSetup, model: Recipe | None) -> dict[str, Band] | None:
    """Return the band of a model that divides none: its own where the run has it, else the run's."""
    if model is None or len(model.image.subbands) != 1:
        return None
    ((name, (low, high)),) = model.image.subbands.items()
    if high - low < 2 * _BANDWIDTH:
        return None
    first, last = float(setup.tones[0]), float(setup.tones[-1])
    return {name: (low, high) if first <= low and high <= last else (first, last)}


def _window_of(setup: RadarSetup, model: Recipe | None) -> str:
    """Return the window of the images: one of low sidelobes where no self-signature is subtracted.

    A model recipe whose window has low sidelobes hands its own on.
    """
    if model is not None and model.image.window != "boxcar":
        return model.image.window
    return "boxcar" if setup.drives else "hann"


def _own_lengths(model: Recipe | None) -> tuple[dict[str, float], float]:
    """Return the lengths of a method for its own array, and the height of that array, m.

    Those of a model without a map of simulated signatures, or for an array that is not packaged,
    stay as they are.
    """
    if model is None:
        return _PAPERS, PAPERS_HEIGHT
    own = {
        "radius": model.prescreen.radius,
        "patch": model.contrast.size * model.contrast.spacing,
        "mean": model.background.mean,
    }
    settings = model.map_settings
    if not hasattr(settings, "outer"):
        return own, 0.0
    own |= {"clear": settings.clear, "guard": settings.guard, "outer": settings.outer}
    is_packaged = settings.sensor in sensor_presets()
    return own, load_sensor(settings.sensor).height if is_packaged else 0.0


def _gap(height: float, near: float) -> float:
    """Return how much longer the path by way of the first pixel is than that of the ground's echo.

    The latter goes down to the ground under the antennas and back.

    Parameters
    ----------
    height : float
        Height of the antennas, m.
    near : float
        Antenna heights ahead at which images begin.
    """
    return 2 * height * (math.hypot(1, near) - 1)


def _longest_cell(setup: RadarSetup, method: _Method) -> float:
    """Return how long a sub-band's range cell may be, m.

    It is shorter than the gap from the ground's echo to the first pixel, and than the outer ring of
    the contrast is wide.
    """
    return min(_gap(setup.height, method.near), 2 * method.lengths["outer"])


def _choose_like(setup: RadarSetup, method: _Method, own: dict[str, Band]) -> Figures:
    """Choose the figures for the method of a recipe with a map, whose own sub-bands are given."""
    least = SPEED_OF_LIGHT / _longest_cell(setup, method)
    divisions = list(divisions_like(setup.tones, own, least))
    for bands in divisions[:-1]:
        try:
            return _choose(setup, method, bands)
        except ValueError:
            continue  # wider sub-bands have more tones
    return _choose(setup, method, divisions[-1])


def _choose(setup: RadarSetup, method: _Method, given: dict[str, Band] | None = None) -> Figures:
    """Choose the figures of a recipe; a ValueError if the run allows no image.

    With sub-bands that are given the last of them limits the looks.
    """
    height = setup.height
    # The main lobe of a Hann window is twice as wide.
    blur = 1 if method.window == "boxcar" else 2
    bands = given or divide(setup.tones, blur * _BANDWIDTH)
    nearest = method.near * height
    middle = _MIDDLE * height
    subband = list(bands)[-1] if given else _prescreener_band(setup, bands, middle)
    band = bands[subband]

    half = _half_width(setup, method)
    reach = min(_most_heights(setup) * height, max(_resolving_reach(setup, band), middle))
    far = _clear_end(setup, list(bands.values()), half, middle, reach + method.beyond)
    reach = min(reach, max(far - method.lengths["patch"] / 2, middle))

    widest = max(high - low for low, high in bands.values())
    range_cell = blur * SPEED_OF_LIGHT / (2 * widest)
    top = max(high for _, high in bands.values()) if given else float(setup.tones[-1])
    fine = min(range_cell, _cross_range(setup, top, nearest))
    range_cell = blur * SPEED_OF_LIGHT / (2 * (band[1] - band[0]))
    middle_of_band = (band[0] + band[1]) / 2
    coarse = min(range_cell, _cross_range(setup, middle_of_band, (nearest + reach) / 2))
    if given and not method.again:
        spacings = _spacing(_MAP_PIXEL * fine, 0.02, 0.05), _spacing(_MAP_PIXEL * coarse, 0.05, 0.1)
    else:
        spacings = _spacing(_PIXEL * fine, 0.01, 0.05), _spacing(_PIXEL * coarse, 0.01, 0.1)
    return Figures(setup, method, bands, subband, half, reach, far, *spacings)


def _band_again(setup: RadarSetup) -> dict[str, Band]:
    """Return the band in which earlier drives predict the ground: to where grating lobes come near."""
    first, last = float(setup.tones[0]), float(setup.tones[-1])
    clear = grating_clear(setup.tx, setup.rx)
    return {"F0": (first, min(last, max(clear, first + _BANDWIDTH)))}


def _half_width(setup: RadarSetup, method: _Method) -> float:
    """Return the half width of the images, m."""
    aside = _ASIDE * setup.height
    if setup.aperture:
        across = float(np.ptp(setup.tx[:, 0]))
        return across / 2 + max(aside, _HALF_VIEW) + method.lengths["patch"] / 2
    return min(max(aside, _LEAST_HALF), 2 * _HALF_VIEW)


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
    slant = _ALARM_RADIUS / _cross_range(setup, sum(band) / 2, 0.0) * setup.height
    return math.sqrt(max(slant**2 - setup.height**2, 0.0))


def _prescreener_band(setup: RadarSetup, bands: dict[str, Band], distance: float) -> str:
    """Return the lowest sub-band that resolves an alarm's radius at a distance, else the last."""
    names = [name for name in bands if name != "F0"]
    for name in names:
        if _resolving_reach(setup, bands[name]) >= distance:
            return name
    return names[-1]


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


def _spacing(wanted: float, least: float, most: float) -> float:
    """Return the spacing of pixels, m, that is nearest to one that is wanted, within limits."""

    def off(spacing: float) -> float:
        return abs(spacing - wanted)

    return min((spacing for spacing in _SPACINGS if least <= spacing <= most), key=off)


def _edge(setup: RadarSetup, edge: float) -> float:
    return float(edge) if edge in setup.tones else float(f"{edge:.6g}")


def pixels_of(lengths: Sequence[float], spacing: float) -> list[int]:
    """Return lengths (m) in odd numbers of pixels."""
    return [2 * round((length / spacing - 1) / 2) + 1 for length in lengths]


def _rounded(distance: float) -> float:
    """Round a distance to 5 cm."""
    return round(20 * distance) / 20


_LENGTHS_OF = {
    "radius": "prescreen.radius",
    "patch": "contrast.size",
    "mean": "background.mean",
    "clear": "map.clear",
    "guard": "map.guard",
    "outer": "map.outer",
}
"""Entries of a recipe whose length follows the height."""
