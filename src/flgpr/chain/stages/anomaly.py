"""Rivals on the run-view: CFAR, RX, and filters matched to the mean signature of the training mines."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
import pandas as pd
import xarray as xr
from pydantic import Field, model_validator

from flgpr.chain.engine import Arrays
from flgpr.chain.stages import FeatureStage, FloatArray, Positive, Setup, Table, TrainingView
from flgpr.chain.stages.clusters import subset
from flgpr.chain.too_few import Tally, TooFewExamplesError, clear_change, kinds_change
from flgpr.detect.scorers.checks import Checked
from flgpr.kernels.moments import ledoit_wolf_moments
from flgpr.screen import select

_EDGE = 1e-9  # m; a pixel whose centre lies on a border lies within it
_MOST = 50_000  # clutter pixels that give mean and covariance
Share = Annotated[float, Field(gt=0, le=1)]


class RxSettings(Table):
    """The alarm's brightest pixel lies within ``reach`` (m); the ring's beyond ``guard``, up to ``outer``.

    Those are half widths, x and y in m. With fewer than ``least`` pixels in the ring the column is
    NaN.
    """

    reach: Positive = 0.3
    guard: tuple[Positive, Positive] = (0.5, 0.5)
    outer: tuple[Positive, Positive] = (1.25, 1.25)
    least: Annotated[int, Field(ge=2)] = 16

    @model_validator(mode="after")
    def _nested(self) -> RxSettings:
        if self.reach > min(self.guard):
            raise ValueError(f"reach must be at most guard {self.guard}, got {self.reach:g}")
        if (np.subtract(self.outer, self.guard) < 0).any() or self.outer == self.guard:
            raise ValueError(
                f"outer must be at least guard {self.guard} and larger in x or y, got {self.outer}"
            )
        return self


class CfarSettings(RxSettings):
    """Channel, by default the first; the ring's level is its "average", or "ordered" the quantile ``share``."""

    polarization: str | None = None
    subband: str | None = None
    kind: Literal["average", "ordered"] = "average"
    share: Share = 0.75


class MatchedSettings(Table):
    """The brightest pixel of an alarm or a mine lies within ``reach``, clutter beyond ``clear`` of all targets (m).

    A ``share`` of the mines makes the signature, of these ``kinds`` alone; no detector is trained
    on them again.
    """

    reach: Positive = 0.3
    kinds: tuple[str, ...] = ("metal", "plastic")
    share: Share = 1.0
    clear: Positive = 1.0


class Rx(FeatureStage):
    """The column ``rx``: squared Mahalanobis distance of the alarm's brightest pixel from the ring about it, signed.

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
        """Return how far the ring reaches."""
        return float(settings.outer[1])

    def of_view(self, view: xr.DataArray, points: FloatArray) -> Mapping[str, FloatArray]:
        """Compare the alarms with their rings."""
        return {"rx": self._compared(view, points)}

    def _compared(self, view: xr.DataArray, points: FloatArray) -> FloatArray:
        (guard_x, guard_y), found = self.settings.guard, np.full(len(points), np.nan)
        for row, place in enumerate(points):
            pixels, u, v = _around(view, place, self.settings.outer)
            brightest = _brightest_of(pixels, u, v, self.settings.reach)
            ring = pixels[(np.abs(u) > guard_x + _EDGE) | (np.abs(v) > guard_y + _EDGE)]
            if brightest is not None and len(ring) >= self.settings.least:
                found[row] = self._excess(brightest, ring)
        return found

    def _excess(self, brightest: FloatArray, ring: FloatArray) -> float:
        mean, covariance = ledoit_wolf_moments(ring)
        off = brightest - mean
        return float(np.sign(off.mean()) * (off @ _inverse(covariance) @ off))


class Cfar(Rx):
    """The column ``cfar``: the alarm's brightest magnitude over the level of the ring about it, dB, in one channel.

    To be compared with a threshold, for a constant false alarm rate. The level is the mean
    magnitude, as in cell averaging (Finn & Johnson, "Adaptive detection mode with threshold control
    as a function of spatially sampled clutter-level estimates", RCA Review 29, 1968), or that which
    ``share`` of the cells do not exceed, which a bright neighbour does not lift (OS-CFAR: Rohling,
    "Radar CFAR thresholding in clutter and multiple target situations", IEEE Trans. Aerospace and
    Electronic Systems 19(4), 1983).
    """

    Settings: ClassVar[type[Table]] = CfarSettings

    def of_view(self, view: xr.DataArray, points: FloatArray) -> Mapping[str, FloatArray]:
        """Compare the alarms with their rings."""
        first = (str(view[axis].values[0]) for axis in ("polarization", "subband"))
        labels = (
            wanted or one
            for wanted, one in zip(
                (self.settings.polarization, self.settings.subband), first, strict=True
            )
        )
        return {"cfar": self._compared(select(view, *labels), points)}

    def _excess(self, brightest: FloatArray, ring: FloatArray) -> float:
        if self.settings.kind == "ordered":
            return float(
                brightest[0] - np.quantile(ring, self.settings.share, method="inverted_cdf")
            )
        return float(brightest[0] - 20 * np.log10((10 ** (ring / 20)).mean()))


class Matched(FeatureStage):
    """The columns ``amf`` and ``ace``: how much of the mines' mean signature s is in an alarm's brightest pixel x.

    Both are vectors as those of :class:`Rx`, less the clutter's mean; C is the clutter's shrunk
    covariance. ``amf`` is sᵀC⁻¹x/√(sᵀC⁻¹s) (Robey, Fuhrmann, Kelly & Nitzberg, "A CFAR adaptive
    matched filter detector", IEEE Trans. Aerospace and Electronic Systems 28(1), 1992), ``ace``
    that over √(xᵀC⁻¹x), a cosine (Kraut & Scharf, "The CFAR adaptive subspace detector is a
    scale-invariant GLRT", IEEE Trans. Signal Processing 47(9), 1999), both with their sign where
    the papers have squares.
    """

    learns = True
    Settings: ClassVar[type[Table]] = MatchedSettings

    @classmethod
    def check_learnt(cls, settings: Any, setup: Setup, learnt: Checked) -> None:  # noqa: ARG003
        """Take the mines' signature, and mean and covariance of the clutter, of all images."""
        images = len(learnt.array("mean", (None,)))
        learnt.array("signature", (images,))
        learnt.array("covariance", (images, images))

    @classmethod
    def margin(cls, settings: Any) -> float:
        """Return how far from an alarm its pixel may lie."""
        return float(settings.reach)

    def of_view(self, view: xr.DataArray, points: FloatArray) -> Mapping[str, FloatArray]:
        """Filter the brightest pixels of the alarms."""
        mean = self.learnt["mean"]
        if math.prod(view.shape[:-2]) != len(mean):
            raise ValueError(
                f"model must have been trained on run-views of {math.prod(view.shape[:-2])} "
                "images, as this one, "
                f"got {len(mean)}"
            )
        off = _brightest(view, points, self.settings.reach) - mean
        inverse = _inverse(self.learnt["covariance"])
        signature = self.learnt["signature"]
        with np.errstate(invalid="ignore"):
            amf = off @ inverse @ signature / np.sqrt(signature @ inverse @ signature)
            return {"amf": amf, "ace": amf / np.sqrt(np.einsum("ni,ij,nj->n", off, inverse, off))}

    @classmethod
    def fit(cls, settings: Any, examples: list[TrainingView]) -> tuple[Arrays, dict[str, Any]]:
        """Take the mean of the mines' brightest pixels, and mean and covariance of the clutter."""
        pairs = zip(examples, cls.targets_used_for_training(settings, examples), strict=True)
        bright = np.concatenate(
            [_brightest(e.view, m[["x", "y"]].to_numpy(), settings.reach) for e, m in pairs]
        )
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
            needed = f"clutter pixels farther than {settings.clear:g} m from all targets, got {len(clutter)}"
            raise TooFewExamplesError(needed, counts, [clear_change(settings)])
        mean, covariance = ledoit_wolf_moments(clutter[:: len(clutter) // _MOST + 1])
        learnt = {"signature": bright.mean(axis=0) - mean, "mean": mean, "covariance": covariance}
        return learnt, {"mines_for_signature": len(bright), "clutter_pixels": len(clutter)}

    @classmethod
    def targets_used_for_training(
        cls, settings: Any, examples: list[TrainingView]
    ) -> list[pd.DataFrame]:
        """Return the mines that make the signature."""
        return [
            some[some["kind"].isin(settings.kinds)]
            for some in subset(examples, settings.share, settings.kinds)
        ]


def _inverse(covariance: FloatArray) -> FloatArray:
    """Inverse in which channels that are copies of each other, as HV and VH may be, count once."""
    return np.asarray(np.linalg.pinv(covariance, rcond=1e-10, hermitian=True), dtype=np.float64)


def _around(
    view: xr.DataArray, place: Any, half: tuple[float, float]
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Log-magnitudes (pixel, channel), dB, of what has one within half widths of a place; x and y counted from it."""
    x, y = (view[axis].values - middle for axis, middle in zip("xy", place, strict=True))
    columns, rows = (
        np.flatnonzero(np.abs(off) <= far + _EDGE) for off, far in zip((x, y), half, strict=True)
    )
    part = view.values.reshape(-1, *view.shape[-2:])[:, rows[:, None], columns].astype(np.float64)
    known = (part > 0).all(axis=0)
    u, v = (each[known] for each in np.meshgrid(x[columns], y[rows]))
    return 20 * np.log10(part[:, known].T), u, v


def _brightest(view: xr.DataArray, points: FloatArray, reach: float) -> FloatArray:
    """Vectors (point, channel) of the pixels within reach that have the largest mean log-magnitude; NaN for none."""
    found = np.full((len(points), math.prod(view.shape[:-2])), np.nan)
    for row, place in enumerate(points):
        brightest = _brightest_of(*_around(view, place, (reach, reach)), reach)
        if brightest is not None:
            found[row] = brightest
    return found


def _brightest_of(
    pixels: FloatArray, u: FloatArray, v: FloatArray, reach: float
) -> FloatArray | None:
    """Vector of that pixel within reach which has the largest mean log-magnitude; None if there is none."""
    near = pixels[np.hypot(u, v) <= reach + _EDGE]
    return near[near.mean(axis=1).argmax()] if len(near) else None


def _clutter(lane: TrainingView, clear: float) -> FloatArray:
    """Vectors (pixel, channel) of what lies in the lane away from all of its targets."""
    (pixels, x, y), area = _around(lane.view, (0, 0), (np.inf, np.inf)), lane.lane
    away = (x >= area.x_min) & (x <= area.x_max) & (y >= area.y_min) & (y <= area.y_max)
    for target in lane.truth[["x", "y"]].to_numpy():
        away &= np.hypot(x - target[0], y - target[1]) > clear
    return pixels[away]
