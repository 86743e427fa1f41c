"""Range ambiguity of stepped tones: an echo of path p gives the same data as one of path p + c/Δf.

Tones Δf apart sample the spectrum of the echoes, so an image shows an echo of path p at p + k·c/Δf
as well, for every whole k. These functions find whether such an alias falls inside an image, and
which step or which image keeps it out.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from flgpr.model.constants import SPEED_OF_LIGHT
from flgpr.model.run import check_frequency
from flgpr.model.sensor import Sensor
from flgpr.types import ArrayLike, FloatArray

Span = tuple[float, float]

ALIAS_LEVEL = 0.25
"""Amplitude over an echo's own from which on its repetition counts as an alias: -12 dB."""
_CHANCE = 3.5  # amplitude over 1/√N that N random tones exceed at one path in 200,000
_EVEN = 1e-3  # spread of the steps of even tones, over the step
_GAP = 20  # usual steps: the response to wider gaps lies beside the echo itself
# Raster cells per usual step to which uneven tones are rounded: 6 degrees of phase at the first
# alias.
_CELLS_PER_STEP = 32
_GRATING = math.radians(50)
_MOST_CELLS = 2**20
_HALVINGS = 40


@dataclass(frozen=True)
class ImagePaths:
    """Paths of an image, from transmitter by a pixel to receiver, m, and its tones' ambiguity."""

    unambiguous: float  #: path after which echoes repeat, see :func:`unambiguous_path`
    cell: float  #: width of a range cell in path, c over the band
    direct: float  #: shortest path of an echo: from a transmitter straight to its receiver
    nearest: float  #: no path by way of the image is shorter
    farthest: float  #: longest path by way of the image

    @property
    def repeats(self) -> bool:
        """Whether the image itself shows an echo twice."""
        return self.farthest - self.nearest >= self.unambiguous

    @property
    def needed(self) -> float:
        """Least unambiguous path that keeps echoes from before the image out of it."""
        return self.farthest + self.cell - self.direct

    @property
    def aliased(self) -> bool:
        """Whether echoes from before the image appear in it again."""
        return self.needed > self.unambiguous

    @property
    def longest_clear(self) -> float:
        """Longest path by way of an image that these tones keep free of echoes from before it."""
        return self.unambiguous + self.direct - self.cell

    @property
    def widest_step(self) -> float:
        """Widest step of even tones for the image, Hz."""
        return SPEED_OF_LIGHT / self.needed


def unambiguous_path(frequency: ArrayLike) -> float:
    """Return the path after which the echoes of tones repeat, m.

    It is c/Δf for even tones and infinite for a single one. Uneven tones repeat exactly after c
    over their greatest common spacing, which may be far off, and nearly as strongly before: half
    the tones 5 MHz and half 2.5 MHz apart show an echo 60 m behind itself with a third of its
    amplitude. So the first path counts at which the response of the tones, ``|Σ_f exp(j2πfL/c)|``
    over their number N, returns to ``ALIAS_LEVEL``, or to 3.5/√N where chance alone brings more;
    infinite if none does within two usual steps' path. Missing tones and gaps up to 20 usual steps
    are no coarser steps: such tones repeat as if none were missing.

    Examples
    --------
    >>> import numpy as np
    >>> from flgpr.model import unambiguous_path
    >>> round(unambiguous_path(300e6 + 8e6 * np.arange(169)), 2)
    37.47
    """
    tones = check_frequency(frequency)
    if tones.size < 2:
        return math.inf
    steps = np.diff(tones)
    if np.ptp(steps) <= _EVEN * steps.mean():
        return SPEED_OF_LIGHT / float(steps.mean())
    return _first_return(tones, float(np.median(steps)))


def _first_return(tones: FloatArray, usual: float) -> float:
    """Return the first path at which the response of uneven tones, on a fine raster, returns."""
    band = float(np.ptp(tones))
    raster = max(usual / _CELLS_PER_STEP, band / _MOST_CELLS)
    cells = np.rint((tones - tones[0]) / raster).astype(np.intp)
    size = 2 ** math.ceil(math.log2(4 * (cells[-1] + 1)))
    response = np.abs(np.fft.rfft(np.bincount(cells, minlength=size))) / tones.size
    path = SPEED_OF_LIGHT / (size * raster) * np.arange(response.size)
    begin = SPEED_OF_LIGHT * max(1 / (_GAP * usual), 2 / band)
    searched = (path >= begin) & (path <= 2.01 * SPEED_OF_LIGHT / usual)
    level = max(ALIAS_LEVEL, _CHANCE / math.sqrt(tones.size))
    high = np.flatnonzero(searched & (response >= level))
    if not high.size:
        return math.inf
    width = max(round(SPEED_OF_LIGHT / band / path[1]), 1)  # of the alias's own main lobe
    lobe = response[high[0] : high[0] + 2 * width]
    return float(path[high[0] + int(lobe.argmax())])


def phase_centre_gap(tx: FloatArray, rx: FloatArray) -> float:
    """Return the widest gap, m, across between the phase centres of pairs (pair, 3); 0 of one centre.

    A pair acts like one antenna for both ways in the middle between its two. With a gap d there is
    a grating lobe at sin θ = λ/2d.
    """
    centres = np.unique(np.round((tx + rx)[:, 0] / 2, 6))
    return float(np.diff(centres).max()) if centres.size > 1 else 0.0


def grating_clear(tx: FloatArray, rx: FloatArray) -> float:
    """Return the highest frequency, Hz, at which grating lobes stay 50 degrees off or farther.

    Nearer ones bring in ground that other scans see in another way. It is infinite for pairs
    (pair, 3) with one phase centre across.
    """
    gap = phase_centre_gap(tx, rx)
    return SPEED_OF_LIGHT / (2 * gap * math.sin(_GRATING)) if gap > 0 else math.inf


def longest_path(tx: ArrayLike, rx: ArrayLike, x: Span, y: Span) -> float:
    """Return the longest path of any pair (pair, 3) by way of a rectangle of ground, m.

    It leads to a corner, as paths are convex.
    """
    corners = np.array([(a, b, 0.0) for a, b in itertools.product(x, y)])[:, None]
    outward = np.linalg.norm(corners - np.asarray(tx), axis=-1)
    back = np.linalg.norm(corners - np.asarray(rx), axis=-1)
    return float((outward + back).max())


def shortest_path(tx: ArrayLike, rx: ArrayLike, x: Span, y: Span) -> float:
    """Return a lower bound of the paths of all pairs (pair, 3) by way of a rectangle of ground, m.

    It is the antennas' distances to the rectangle, each to the point that is nearest to it.
    """
    total = 0.0
    for end in (np.asarray(tx, dtype=float), np.asarray(rx, dtype=float)):
        across = end[:, 0] - np.clip(end[:, 0], *x)
        ahead = end[:, 1] - np.clip(end[:, 1], *y)
        total = total + np.sqrt(across**2 + ahead**2 + end[:, 2] ** 2)
    return float(np.min(total))


def image_paths(frequency: ArrayLike, tx: ArrayLike, rx: ArrayLike, x: Span, y: Span) -> ImagePaths:
    """Return the paths by way of an image and the ambiguity of its tones.

    The shortest path of an echo is that of the direct coupling, the brightest of all: subtracting
    the self-signature leaves what of it drifts. The ground below the antennas follows at twice
    their height.

    Parameters
    ----------
    frequency : (frequency,) array_like
        Tones, Hz.
    tx, rx : (pair, 3) array_like
        Antennas in the scan frame, heights over the ground, m.
    x, y : tuple of float
        Borders of the image in the scan frame, m.

    Returns
    -------
    ImagePaths
        The paths.
    """
    tones = check_frequency(frequency)
    direct = np.linalg.norm(np.asarray(tx, dtype=float) - np.asarray(rx, dtype=float), axis=-1)
    band = float(np.ptp(tones))
    cell = SPEED_OF_LIGHT / band if band else 0.0
    return ImagePaths(
        unambiguous_path(tones),
        cell,
        float(direct.min()),
        shortest_path(tx, rx, x, y),
        longest_path(tx, rx, x, y),
    )


def tightest_paths(
    frequency: ArrayLike,
    subbands: Mapping[str, Span],
    tx: ArrayLike,
    rx: ArrayLike,
    x: Span,
    y: Span,
) -> ImagePaths:
    """Return :func:`image_paths` of the sub-band (Hz) with the least room.

    Sub-bands without a tone are skipped; if all are, the whole band counts.
    """
    tones = check_frequency(frequency)
    paths = []
    for low, high in subbands.values():
        in_band = tones[(tones >= low) & (tones <= high)]
        if in_band.size:
            paths.append(image_paths(in_band, tx, rx, x, y))
    if not paths:
        paths = [image_paths(tones, tx, rx, x, y)]
    return min(paths, key=lambda of_band: of_band.unambiguous - of_band.needed)


def clear_end(paths: ImagePaths, tx: ArrayLike, rx: ArrayLike, x: Span, y: Span) -> float:
    """Return how far ahead an image may end, m, without echoes from before it.

    It is NaN if the image may not even begin.
    """
    most = paths.longest_clear
    clear, aliased = y
    if longest_path(tx, rx, x, (clear, clear)) > most:
        return math.nan
    for _ in range(_HALVINGS):
        middle = (clear + aliased) / 2
        if longest_path(tx, rx, x, (y[0], middle)) > most:
            aliased = middle
        else:
            clear = middle
    return clear


def check_tones(sensor: Sensor, x: Span, y: Span) -> ImagePaths:
    """Refuse tones that let echoes from before an image (m, scan frame) appear in it.

    Raises
    ------
    ValueError
        If ``tones.step`` is wider than c over the image's longest path and a range cell less the
        shortest path of an echo. The error names the widest step, and where the image may end with
        the step of the sensor.
    """
    tx, rx = (side + [0.0, 0.0, sensor.height] for side in sensor.pairs())
    paths = image_paths(sensor.tones.axis(), tx, rx, x, y)
    if not paths.aliased:
        return paths
    widest = math.floor(paths.widest_step / 1e4) / 100
    end = clear_end(paths, tx, rx, x, y)
    shorter_image = ""
    if math.isfinite(end):
        shorter_image = f", or end the image {math.floor(100 * end) / 100:g} m ahead"
    raise ValueError(
        f"tones.step must be at most {widest:g} MHz for an image up to {y[1]:g} m ahead, whose "
        f"longest path is {paths.farthest:.4g} m, got {sensor.tones.step / 1e6:g} MHz: "
        f"echoes repeat after {paths.unambiguous:.4g} m of path, so what lies under and before "
        f"the sensor appears in the image again; take finer steps{shorter_image}"
    )
