"""What steps between tones keep apart: an echo of path p is the same data as one of path p + c/Δf.

Tones Δf apart sample the spectrum of the echoes, so an image shows an echo of path p at p + k·c/Δf as well, for every
whole k. This tells whether such an alias falls inside an image, and what step or what image would keep it out.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flgpr.model.constants import SPEED_OF_LIGHT
from flgpr.model.run import check_frequency
from flgpr.model.sensor import Sensor

FloatArray = NDArray[np.float64]
Span = tuple[float, float]

ALIAS_LEVEL = 0.25
"""Amplitude over an echo's own from which on its repetition counts as an alias: -12 dB."""
_CHANCE = 3.5  # amplitude over 1/√N that N tones at random places pass at one path in 200,000
_EVEN = 1e-3  # spread of the steps of even tones, over the step
_GAP = 20  # usual steps: what wider gaps do to the response lies beside the echo itself
# places per usual step to which uneven tones are rounded: 6 degrees of phase at the first alias
_FINENESS = 32
_MOST_PLACES = 2**20
_HALVINGS = 40


@dataclass(frozen=True)
class ImagePaths:
    """Paths of an image (m, from transmitter by way of a pixel to receiver) against what its tones keep apart."""

    unambiguous: float  #: path after which echoes repeat, see :func:`unambiguous_path`
    cell: float  #: width of a range cell in path, c over the band
    #: shortest path that an echo can have: from a transmitter straight to its receiver
    direct: float
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
    """Give the path after which the echoes of tones repeat, m: c/Δf for even tones, infinite for a single one.

    Uneven tones repeat exactly after c over their greatest common spacing, which may be far off,
    and nearly as strongly before: half the tones 5 MHz and half 2.5 MHz apart show an echo 60 m
    behind itself with a third of its amplitude. So the first path counts at which the response of
    the tones, ``|Σ_f exp(j2πfL/c)|`` over their number N, comes back to ``ALIAS_LEVEL``, or to
    3.5/√N where chance alone brings more; infinite if none does within two usual steps' path.
    Missing tones and gaps up to 20 usual steps are no coarser steps: such tones repeat as if none
    were missing.

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
    """Find the first path at which the response of uneven tones, rounded to a fine raster, comes back."""
    band = float(np.ptp(tones))
    raster = max(usual / _FINENESS, band / _MOST_PLACES)
    places = np.rint((tones - tones[0]) / raster).astype(np.intp)
    size = 2 ** math.ceil(math.log2(4 * (places[-1] + 1)))
    response = np.abs(np.fft.rfft(np.bincount(places, minlength=size))) / tones.size
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


def alias_paths(path: float, unambiguous: float, nearest: float, farthest: float) -> FloatArray:
    """Give the paths (n,) from ``nearest`` to ``farthest`` at which an echo appears besides its own, m, rising."""
    if not math.isfinite(unambiguous):
        return np.empty(0)
    first = math.ceil((nearest - path) / unambiguous)
    last = math.floor((farthest - path) / unambiguous)
    times = np.arange(first, last + 1)
    return path + unambiguous * times[times != 0]


def longest_path(tx: ArrayLike, rx: ArrayLike, x: Span, y: Span) -> float:
    """Give the longest path of any pair (pair, 3) by way of a rectangle of ground, to a corner: paths are convex."""
    corners = np.array([(a, b, 0.0) for a, b in itertools.product(x, y)])[:, None]
    return float(sum(np.linalg.norm(corners - np.asarray(end), axis=-1) for end in (tx, rx)).max())


def shortest_path(tx: ArrayLike, rx: ArrayLike, x: Span, y: Span) -> float:
    """Give a path that none of any pair (pair, 3) by way of a rectangle of ground falls below.

    It is the antennas' distances to the rectangle, each to the point that is nearest to it.
    """
    total = 0.0
    for end in (np.asarray(tx, dtype=float), np.asarray(rx, dtype=float)):
        beside = end[:, 0] - np.clip(end[:, 0], *x)
        ahead = end[:, 1] - np.clip(end[:, 1], *y)
        total = total + np.sqrt(beside**2 + ahead**2 + end[:, 2] ** 2)
    return float(np.min(total))


def image_paths(frequency: ArrayLike, tx: ArrayLike, rx: ArrayLike, x: Span, y: Span) -> ImagePaths:
    """Compare the paths by way of an image with what its tones (Hz) keep apart.

    Antennas (pair, 3) and the image's borders are in the scan frame, heights over the ground. The shortest path that an
    echo can have is that of the direct coupling, the brightest of all: subtracting the self-signature leaves of it what
    drifts. The ground below the antennas follows at twice their height.
    """
    tones = check_frequency(frequency)
    direct = np.linalg.norm(np.asarray(tx, dtype=float) - np.asarray(rx, dtype=float), axis=-1)
    band = float(np.ptp(tones))
    cell = SPEED_OF_LIGHT / band if band else 0.0
    paths = shortest_path(tx, rx, x, y), longest_path(tx, rx, x, y)
    return ImagePaths(unambiguous_path(tones), cell, float(direct.min()), *paths)


def tightest_paths(
    frequency: ArrayLike,
    subbands: Mapping[str, Span],
    tx: ArrayLike,
    rx: ArrayLike,
    x: Span,
    y: Span,
) -> ImagePaths:
    """Compare an image's paths with the tones of every sub-band (Hz) by themselves; give what has least room.

    Sub-bands without a tone are passed over; without any other the whole band counts.
    """
    tones = check_frequency(frequency)
    chosen = [tones[(tones >= low) & (tones <= high)] for low, high in subbands.values()]
    found = [image_paths(part, tx, rx, x, y) for part in chosen if part.size]
    return min(
        found or [image_paths(tones, tx, rx, x, y)],
        key=lambda paths: paths.unambiguous - paths.needed,
    )


def clear_end(paths: ImagePaths, tx: ArrayLike, rx: ArrayLike, x: Span, y: Span) -> float:
    """Give how far ahead an image may end, m, for echoes from before it to stay out; NaN if it may not even begin."""
    most = paths.longest_clear
    near, far = y
    if longest_path(tx, rx, x, (near, near)) > most:
        return math.nan
    for _ in range(_HALVINGS):
        middle = (near + far) / 2
        if longest_path(tx, rx, x, (y[0], middle)) > most:
            far = middle
        else:
            near = middle
    return near


def check_tones(sensor: Sensor, x: Span, y: Span) -> ImagePaths:
    """Refuse tones that let echoes from before an image (m, scan frame) appear in it.

    Raises
    ------
    ValueError
        ``tones.step`` is wider than c over the image's longest path and a range cell less the
        shortest path that an echo can have; the error tells the widest step, and where the image
        may end for the step given.
    """
    tx, rx = (side + [0.0, 0.0, sensor.height] for side in sensor.pairs())
    paths = image_paths(sensor.tones.axis(), tx, rx, x, y)
    if paths.aliased:
        end = clear_end(paths, tx, rx, x, y)
        mend = (
            f", or end the image {math.floor(100 * end) / 100:g} m ahead"
            if math.isfinite(end)
            else ""
        )
        raise ValueError(
            f"tones.step must be at most {math.floor(paths.widest_step / 1e4) / 100:g} MHz for an image up to "
            f"{y[1]:g} m ahead, whose longest path is {paths.farthest:.4g} m, got {sensor.tones.step / 1e6:g} MHz: "
            f"echoes repeat after {paths.unambiguous:.4g} m of path, so what lies under and before the sensor appears "
            f"in the image again; take finer steps{mend}"
        )
    return paths
