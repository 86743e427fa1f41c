"""The tables of a recipe: what a user may write, with units, bounds and defaults."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Literal

from pydantic import AfterValidator, Field, model_validator

from flgpr.detect.estimator_table import known_estimators
from flgpr.features import PatchShape
from flgpr.kernels.windows import WINDOWS, ramp
from flgpr.model import POLARIZATIONS, Grid, Lane
from flgpr.model.bounds import Largest, Spacing
from flgpr.stages import Positive, Table
from flgpr.types import FloatArray


def _increasing(limits: tuple[float, float]) -> tuple[float, float]:
    """Return limits that increase; refuse others."""
    if not limits[1] > limits[0]:
        raise ValueError(f"must increase, got {limits[0]:g}, {limits[1]:g}")
    return limits


def _one_of(*names: str) -> AfterValidator:
    """Return what refuses other names than these."""

    def known(name: str) -> str:
        if name not in names:
            raise ValueError(f"must be one of {', '.join(names)}, got {name!r}")
        return name

    return AfterValidator(known)


Metre = Annotated[float, Field(ge=-100_000, le=100_000)]
Limits = Annotated[tuple[Metre, Metre], AfterValidator(_increasing)]
Band = Annotated[tuple[float, float], AfterValidator(_increasing)]
Window = Annotated[float, Field(ge=1e-3, le=100)]
Pixels = Annotated[int, Field(ge=1, le=1001)]
Polarization = Annotated[str, _one_of(*POLARIZATIONS)]


class ImageTable(Table):
    """Scan images: pixels in the scan frame (m) and sub-bands (Hz).

    ``spacing`` (m) may be one length or two, cross-track and down-track. The window "ramp" is that
    of filtered backprojection; ``tolerance`` is that of the imaging operator, and ``device`` is
    where it computes. ``polarizations`` are those that are imaged, by default all.

    An image is the coherent mean over the last ``frames`` scans, on the ground ahead of the latest
    (Fuse et al. 2018, Eq. 4). With "all" the whole run is one scan, see
    :func:`flgpr.model.aperture_run`: for a radar that moves past what it looks at.
    """

    x: Limits
    y: Limits
    spacing: Spacing | tuple[Spacing, Spacing]
    subbands: Annotated[dict[str, Band], Field(min_length=1), Largest(1e12)]
    window: Annotated[str, _one_of(*WINDOWS, "ramp")] = "boxcar"
    tolerance: Annotated[float, Field(gt=0, lt=1)] = 1e-3
    polarizations: tuple[Polarization, ...] = ()
    frames: Annotated[int, Field(ge=1, le=1000)] | Literal["all"] = 1
    device: Literal["cpu", "cuda"] = "cpu"

    @property
    def summed(self) -> int:
        """Number of scans that an image sums; an aperture counts as one scan."""
        return 1 if self.frames == "all" else self.frames

    @property
    def steps(self) -> tuple[float, float]:
        """Spacing cross-track and down-track, m."""
        if isinstance(self.spacing, tuple):
            return self.spacing
        return (self.spacing, self.spacing)

    def grid(self) -> Grid:
        """Return the grid of the scan images, in the scan frame."""
        dx, dy = self.steps
        if dx == dy:
            return Grid.spanning(self.x, self.y, dx)
        nx = round((self.x[1] - self.x[0]) / dx) + 1
        ny = round((self.y[1] - self.y[0]) / dy) + 1
        return Grid(self.x[0], self.y[0], nx, ny, dx, dy)

    def weights(self, frequency: FloatArray) -> str | FloatArray:
        """Return the window for tones (Hz) as the imaging operator takes it."""
        return ramp(frequency) if self.window == "ramp" else self.window


class BackgroundTable(Table):
    """Self-signature (Wang et al. 2007, Eq. 2) and gain background.

    The gain background is one of

    - "smooth": filtered by the windows ``median`` and ``mean`` (m; Wang et al. 2007, Eq. 3 and 4),
    - "rows": one level for each row, the median within ``within`` metres of the middle (Fuse et al.
      2018),
    - "none".

    The median is taken at every ``median_step``-th pixel, see
    :class:`flgpr.clutter.BackgroundEstimator`.
    """

    self_signature: Literal["none", "mean", "median"]
    gain: Literal["smooth", "rows", "none"] = "smooth"
    median: Window = 1.05
    mean: Window = 2.55
    median_step: Pixels = 1
    within: Positive | None = None

    def windows(
        self, dx: float, dy: float | None = None
    ) -> tuple[tuple[int, int], tuple[int, int]]:
        """Return the windows (y, x) of the median and the mean, in odd numbers of pixels.

        Parameters
        ----------
        dx, dy : float
            Spacing of the pixels, m; without ``dy`` it is ``dx`` both ways.
        """

        def odd_pixels(length: float, step: float) -> int:
            return max(2 * round((length / step - 1) / 2) + 1, 1)

        if dy is None:
            dy = dx
        median = (odd_pixels(self.median, dy), odd_pixels(self.median, dx))
        mean = (odd_pixels(self.mean, dy), odd_pixels(self.mean, dx))
        return median, mean


class RunViewTable(Table):
    """Run-view: pixels in the lane frame (m) and the farthest distance ahead of the array (m).

    Without ``y`` it is as long as the lane. Where no lane is given, ``search`` says which ground is
    searched: a "lane" 3 m wide about the vehicle's course, or the "view" in its whole width.

    ``look`` says what the scans that see a pixel make of it:

    - "second-largest": the second largest magnitude (Wang et al. 2007, Sec. II-B),
    - "mean": the mean, in which a look weighs as its distance to the power -``falloff``,
    - "ranges": a view for each of the ``ranges`` ahead of the array (m), of the scan that sees the
      pixel nearest to that range, at most ``within`` off (flsar2004).
    """

    x: Limits
    y: Limits | None = None
    spacing: Spacing
    y_max: Annotated[float, Field(gt=0, le=1000)]
    search: Literal["lane", "view"] = "lane"
    look: Literal["second-largest", "mean", "ranges"] = "second-largest"
    falloff: Annotated[float, Field(ge=0, le=10)] = 0.0
    ranges: tuple[Positive, ...] = ()
    within: Positive = 2.5

    @model_validator(mode="after")
    def _entries_of_look(self) -> RunViewTable:
        """Refuse entries of another look."""
        if (self.look == "ranges") != bool(self.ranges):
            raise ValueError(
                f'ranges must be given with the look "ranges" and only then, got {self.ranges}'
            )
        if self.falloff and self.look != "mean":
            raise ValueError(
                f'falloff must be left out unless the look is "mean", got {self.falloff:g}'
            )
        return self

    def grid(self, lane: Lane) -> Grid:
        """Return the grid of the run-view of a lane, in the lane frame."""
        return Grid.spanning(self.x, self.y or (lane.y_min, lane.y_max), self.spacing)

    def channels(self, subbands: Sequence[str]) -> list[str]:
        """Return the names of the run-view's sub-bands, or of the ranges in each of them."""
        if self.look != "ranges":
            return list(subbands)
        names = []
        for band in subbands:
            prefix = f"{band} " if len(subbands) > 1 else ""
            for distance in self.ranges:
                names.append(f"{prefix}{distance:g} m")
        return names


class PrescreenTable(Table):
    """Prescreener (Wang et al. 2007, Sec. II-B): channel, alarm radius (m) and density.

    ``count`` says where the density rule counts maxima and area.
    """

    polarization: str
    subband: str
    radius: Window
    density: Annotated[float, Field(gt=0, le=10_000)]
    count: Literal["lane", "view"] = "lane"


class ContrastTable(Table):
    """Local contrast as confidence: channel and patch (pixels; spacing in m)."""

    polarization: Polarization
    subband: str
    size: Pixels = 25
    spacing: Spacing = 0.1
    inner: tuple[Pixels, Pixels] = (5, 3)
    guard: tuple[Pixels, Pixels] = (9, 7)

    def patch(self) -> PatchShape:
        """Return the patch of the contrast feature."""
        return PatchShape(self.size, self.spacing, self.inner, self.guard)


class FeaturesTable(Table):
    """The ten features of every sub-band (Wang et al. 2007, Eq. 5 to 17).

    Their patches are those of the table ``contrast``; ``inner`` is the region of the coherent patch
    that is averaged (pixels, cross-track x down-track). ``psi`` says how angles are averaged. The
    images of the polarimetric features are divided by one ``gain`` and background that the
    polarizations share, which keeps their ratios, or by each polarization's own, as in the paper.

    With ``variants`` the features are computed twice more: with cross-track and down-track
    exchanged in all regions, and the polarimetric ones with the other ``gain`` and the mean of ψ
    that goes with it.
    """

    inner: tuple[Pixels, Pixels] = (5, 3)
    psi: Literal["circular", "linear"] = "circular"
    gain: Literal["shared", "own"] = "shared"
    variants: bool = False


class DetectorTable(Table):
    """The estimator that is trained on the features of alarms, and the features that it reads.

    ``estimator`` is "fisher" (Wang et al. 2007: histogram normaliser, duplication of hits, Fisher
    discriminant), or one of ``detect/estimator_table.py`` or of another distribution, with its
    ``options``. ``scale`` "standard" brings every feature to zero mean and unit deviation before.
    ``features`` are columns; names may end in ``*``. Of "mkl" every entry is a group of features
    with a kernel of its own.

    With ``on`` "mines" it is trained on the mines alone. With "clutter" it is trained on all other
    alarms, and what is unlike them scores high.
    """

    estimator: str = "fisher"
    features: tuple[str, ...] = ()
    options: dict[str, bool | int | float | str] = Field(default_factory=dict)
    scale: Literal["standard", "none"] = "standard"
    on: Literal["all", "mines", "clutter"] = "all"

    @model_validator(mode="after")
    def _known(self) -> DetectorTable:
        """Refuse an estimator that there is not."""
        if self.estimator not in ("fisher", *known_estimators()):
            known = ", ".join(("fisher", *known_estimators()))
            raise ValueError(f"estimator must be one of {known}, got {self.estimator!r}")
        return self


class LaneTable(Table):
    """The lane: borders in the lane frame (m)."""

    x_min: float
    x_max: float
    y_min: float
    y_max: float

    @model_validator(mode="after")
    def _not_empty(self) -> LaneTable:
        """Refuse borders that a lane refuses."""
        self.lane()
        return self

    def lane(self) -> Lane:
        """Return the lane."""
        return Lane(**self.model_dump())


class ScoreTable(Table):
    """Scoring: halo radius (m), and the area that false alarms are counted on.

    The area is

    - "union": that of the lane less the union of the halos,
    - "paper": that of the lane less the sum of the halos (Wang et al. 2007),
    - "frames": the detection area of every frame, which raises alarms of its own (Fuse et al. 2018,
      Sec. 4).
    """

    halo: Window
    area: Literal["union", "paper", "frames"] = "union"
