"""Rivals on the run-view: CFAR, RX, and filters matched to the mean signature of the mines."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, Literal, NamedTuple

import numpy as np
import pandas as pd
import xarray as xr
from pydantic import Field, model_validator

from flgpr.detect.scorers.checks import Checked
from flgpr.kernels.moments import ledoit_wolf_moments
from flgpr.screen import select
from flgpr.stages import FeatureStage, Positive, Setup, Table, TrainingView
from flgpr.stages.clusters import subset
from flgpr.stages.too_few import Tally, TooFewExamplesError, clear_change
from flgpr.types import Arrays, Entries, FloatArray, floats
from flgpr_ground.stages.run_views import check_images, kinds_change

_EDGE = 1e-9  # m; a pixel whose centre lies on a border lies within it
_MOST = 50_000  # clutter pixels that give mean and covariance
Share = Annotated[float, Field(gt=0, le=1)]


class RxSettings(Table):
    """An alarm's pixel and the ring about it, m."""

    reach: Positive = 0.3  #: within which the alarm's brightest pixel lies
    guard: tuple[Positive, Positive] = (0.5, 0.5)  #: half widths x and y inside the ring
    outer: tuple[Positive, Positive] = (1.25, 1.25)  #: half widths x and y of the ring
    least: Annotated[int, Field(ge=2)] = 16  #: pixels of the ring; with fewer the column is NaN

    @model_validator(mode="after")
    def _nested(self) -> RxSettings:
        """Refuse regions that do not enclose one another."""
        if self.reach > min(self.guard):
            raise ValueError(f"reach must be at most guard {self.guard}, got {self.reach:g}")
        if (np.subtract(self.outer, self.guard) < 0).any() or self.outer == self.guard:
            raise ValueError(
                f"outer must be at least guard {self.guard} and larger in x or y, got {self.outer}"
            )
        return self


class CfarSettings(RxSettings):
    """Channel, and what the level of the ring is."""

    polarization: str | None = None  #: of the channel; by default the first
    subband: str | None = None  #: of the channel; by default the first
    kind: Literal["average", "ordered"] = "average"  #: the mean, or with "ordered" a quantile
    share: Share = 0.75  #: the quantile


class MatchedSettings(Table):
    """Pixels of mines and of clutter, m."""

    reach: Positive = 0.3  #: within which the brightest pixel of an alarm or a mine lies
    kinds: tuple[str, ...] = ("metal", "plastic")  #: kinds of targets that are mines
    #: of these mines that makes the signature; no detector is trained on them again
    share: Share = 1.0
    clear: Positive = 1.0  #: least distance of clutter from all targets


class _Pixels(NamedTuple):
    """Pixels of a run-view about a point that have a magnitude."""

    level: FloatArray  # (pixel, channel) log-magnitudes, dB
    x: FloatArray  # (pixel,) offsets from the point, m
    y: FloatArray


class Rx(FeatureStage):
    """The column ``rx``: squared Mahalanobis distance of an alarm's brightest pixel from its ring.

    A pixel's vector holds its log-magnitudes (dB) in all channels, polarization x sub-band; the
    brightest has the largest mean of them. The covariance of the ring is shrunk (Ledoit & Wolf
    2004). So that dark spots do not alarm, the distance is negative where that mean is below the
    ring's. Pixels without a magnitude are left out. After Reed & Yu, "Adaptive multiple-band CFAR
    detection of an optical pattern with unknown spectral distribution", IEEE Trans. Acoustics,
    Speech, and Signal Processing 38(10), 1990.
    """

    Settings: ClassVar[type[Table]] = RxSettings

    @classmethod
    def margin(cls, settings: Any) -> float:
        """Return how far the ring reaches, m."""
        return float(settings.outer[1])

    def of_view(self, view: xr.DataArray, points: FloatArray) -> Mapping[str, FloatArray]:
        """Return the distances of the alarms from their rings."""
        return {"rx": self._compared(view, points)}

    def _compared(self, view: xr.DataArray, points: FloatArray) -> FloatArray:
        """Return how much each alarm exceeds its ring; NaN where there is no ring."""
        excess = np.full(len(points), np.nan)
        for number, point in enumerate(points):
            pixels = _around(view, point, self.settings.outer)
            brightest = _brightest_of(pixels, self.settings.reach)
            offsets = np.abs([pixels.x, pixels.y]).T
            ring = pixels.level[(offsets > np.array(self.settings.guard) + _EDGE).any(axis=1)]
            if brightest is not None and len(ring) >= self.settings.least:
                excess[number] = self._excess(brightest, ring)
        return excess

    def _excess(self, brightest: FloatArray, ring: FloatArray) -> float:
        """Return how much a pixel (channel,) exceeds a ring (pixel, channel)."""
        mean, covariance = ledoit_wolf_moments(ring)
        off = brightest - mean
        return float(np.sign(off.mean()) * (off @ _inverse(covariance) @ off))


class Cfar(Rx):
    """The column ``cfar``: an alarm's brightest magnitude over the level of its ring, dB.

    It is that of one channel, to be compared with a threshold for a constant false alarm rate. The
    level is the mean magnitude, as in cell averaging (Finn & Johnson, "Adaptive detection mode with
    threshold control as a function of spatially sampled clutter-level estimates", RCA Review 29,
    1968), or that which ``share`` of the cells do not exceed, which a bright neighbour does not
    lift (OS-CFAR: Rohling, "Radar CFAR thresholding in clutter and multiple target situations",
    IEEE Trans. Aerospace and Electronic Systems 19(4), 1983).
    """

    Settings: ClassVar[type[Table]] = CfarSettings

    def of_view(self, view: xr.DataArray, points: FloatArray) -> Mapping[str, FloatArray]:
        """Return how much the alarms exceed their rings."""
        polarization = self.settings.polarization or str(view["polarization"].values[0])
        subband = self.settings.subband or str(view["subband"].values[0])
        return {"cfar": self._compared(select(view, polarization, subband), points)}

    def _excess(self, brightest: FloatArray, ring: FloatArray) -> float:
        """Return how much a pixel (1,) exceeds the level of a ring (pixel, 1), dB."""
        if self.settings.kind == "ordered":
            level = np.quantile(ring, self.settings.share, method="inverted_cdf")
            return float(brightest[0] - level)
        mean_magnitude = (10 ** (ring / 20)).mean()
        return float(brightest[0] - 20 * np.log10(mean_magnitude))


class Matched(FeatureStage):
    """The columns ``amf`` and ``ace``: how much of the mines' mean signature s an alarm has.

    Its brightest pixel x and s are vectors as those of :class:`Rx`, less the clutter's mean; C is
    the clutter's shrunk covariance. ``amf`` is sᵀC⁻¹x/√(sᵀC⁻¹s) (Robey, Fuhrmann, Kelly & Nitzberg,
    "A CFAR adaptive matched filter detector", IEEE Trans. Aerospace and Electronic Systems 28(1),
    1992), ``ace`` that over √(xᵀC⁻¹x), a cosine (Kraut & Scharf, "The CFAR adaptive subspace
    detector is a scale-invariant GLRT", IEEE Trans. Signal Processing 47(9), 1999), both with their
    sign where the papers have squares.
    """

    learns = True
    Settings: ClassVar[type[Table]] = MatchedSettings

    @classmethod
    def check_learnt(cls, settings: Any, setup: Setup, learnt: Checked) -> None:  # noqa: ARG003
        """Check the mines' signature, and mean and covariance of the clutter, of all channels."""
        channels = len(learnt.array("mean", (None,)))
        learnt.array("signature", (channels,))
        learnt.array("covariance", (channels, channels))

    @classmethod
    def margin(cls, settings: Any) -> float:
        """Return how far from an alarm its pixel may lie, m."""
        return float(settings.reach)

    def of_view(self, view: xr.DataArray, points: FloatArray) -> Mapping[str, FloatArray]:
        """Filter the brightest pixels of the alarms."""
        mean = self.learnt["mean"]
        check_images(view, len(mean))
        off = _brightest(view, points, self.settings.reach) - mean
        inverse = _inverse(self.learnt["covariance"])
        signature = self.learnt["signature"]
        with np.errstate(invalid="ignore"):  # NaN for alarms without a pixel
            amf = off @ inverse @ signature / np.sqrt(signature @ inverse @ signature)
            ace = amf / np.sqrt(np.einsum("ni,ij,nj->n", off, inverse, off))
        return {"amf": amf, "ace": ace}

    @classmethod
    def fit(cls, settings: Any, examples: list[TrainingView]) -> tuple[Arrays, Entries]:
        """Learn the mean of the mines' brightest pixels, and mean and covariance of the clutter."""
        bright_by_lane = []
        mines_by_lane = cls.targets_used_for_training(settings, examples)
        for lane, mines in zip(examples, mines_by_lane, strict=True):
            bright_by_lane.append(
                _brightest(lane.view, mines[["x", "y"]].to_numpy(), settings.reach)
            )
        bright = np.concatenate(bright_by_lane)
        bright = bright[np.isfinite(bright).all(axis=1)]
        clutter = np.concatenate([_clutter(lane, settings.clear) for lane in examples])

        counts = [
            Tally(len(bright), "targets that make the signature"),
            Tally(len(clutter), "clutter pixels"),
        ]
        if not len(bright):
            needed = f"targets of the kinds {', '.join(settings.kinds)} that are seen, got none"
            raise TooFewExamplesError(needed, counts, kinds_change(settings, examples))
        if len(clutter) < 2:
            needed = (
                f"clutter pixels farther than {settings.clear:g} m from all targets, "
                f"got {len(clutter)}"
            )
            raise TooFewExamplesError(needed, counts, [clear_change(settings)])
        mean, covariance = ledoit_wolf_moments(clutter[:: len(clutter) // _MOST + 1])
        learnt = {"signature": bright.mean(axis=0) - mean, "mean": mean, "covariance": covariance}
        return learnt, {"mines_for_signature": len(bright), "clutter_pixels": len(clutter)}

    @classmethod
    def targets_used_for_training(
        cls, settings: Any, examples: list[TrainingView]
    ) -> list[pd.DataFrame]:
        """Return the mines that make the signature."""
        lanes = subset(examples, settings.share, settings.kinds)
        return [targets[targets["kind"].isin(settings.kinds)] for targets in lanes]


def _inverse(covariance: FloatArray) -> FloatArray:
    """Return the inverse in which channels that are copies of each other count once.

    HV and VH may be copies.
    """
    return floats(np.linalg.pinv(covariance, rcond=1e-10, hermitian=True))


def _around(view: xr.DataArray, centre: Any, half: tuple[float, float]) -> _Pixels:
    """Return the pixels within half widths (x, y) of a point that have a magnitude."""
    x = view["x"].values - centre[0]
    y = view["y"].values - centre[1]
    columns = np.flatnonzero(np.abs(x) <= half[0] + _EDGE)
    rows = np.flatnonzero(np.abs(y) <= half[1] + _EDGE)
    channels = view.values.reshape(-1, *view.shape[-2:])
    magnitude = floats(channels[:, rows[:, None], columns])
    known = (magnitude > 0).all(axis=0)
    u, v = np.meshgrid(x[columns], y[rows])
    return _Pixels(20 * np.log10(magnitude[:, known].T), u[known], v[known])


def _brightest(view: xr.DataArray, points: FloatArray, reach: float) -> FloatArray:
    """Return the vectors (point, channel) of the brightest pixels within reach; NaN for none."""
    vectors = np.full((len(points), math.prod(view.shape[:-2])), np.nan)
    for number, point in enumerate(points):
        brightest = _brightest_of(_around(view, point, (reach, reach)), reach)
        if brightest is not None:
            vectors[number] = brightest
    return vectors


def _brightest_of(pixels: _Pixels, reach: float) -> FloatArray | None:
    """Return the vector (channel,) of the pixel within reach with the largest mean log-magnitude.

    None if there is no pixel.
    """
    within_reach = pixels.level[np.hypot(pixels.x, pixels.y) <= reach + _EDGE]
    if not len(within_reach):
        return None
    brightest: FloatArray = within_reach[within_reach.mean(axis=1).argmax()]
    return brightest


def _clutter(lane: TrainingView, clear: float) -> FloatArray:
    """Return the vectors (pixel, channel) of what lies in the lane away from all of its targets."""
    pixels = _around(lane.view, (0, 0), (np.inf, np.inf))
    free = lane.lane.contains(pixels.x, pixels.y)
    for target in lane.truth[["x", "y"]].to_numpy():
        free &= np.hypot(pixels.x - target[0], pixels.y - target[1]) > clear
    return pixels.level[free]
