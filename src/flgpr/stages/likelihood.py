"""A map of how much likelier a look is with a mine under it than without.

Signatures of simulated bodies are compared with clutter that is learnt from training lanes.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Callable, Sequence
from typing import Annotated, Any, ClassVar, NamedTuple

import numpy as np
import pandas as pd
import xarray as xr
from pydantic import Field, model_validator
from scipy.ndimage import gaussian_filter, uniform_filter

from flgpr.detect.scorers.checks import Checked
from flgpr.engine import Accumulator, sum_accumulator
from flgpr.model import Grid, Sensor, scan_to_lane
from flgpr.model.bounds import AtLeastOne, NotNegative, Spacing
from flgpr.screen.views import pixels_at
from flgpr.stages import MapStage, Positive, Setup, Table, imaged_labels
from flgpr.stages.body_signatures import (
    OWN_ARRAY,
    Bodies,
    Imaging,
    sensor_of,
    signatures,
    window_of,
)
from flgpr.stages.textured_clutter import (
    SHAPES,
    SomeValues,
    WhitenedGround,
    clutter_whitener,
    principal_directions,
    ratio,
    shape_counts,
    summed_clutter,
)
from flgpr.stages.too_few import Tally, TooFewExamplesError, clear_change
from flgpr.types import (
    Arrays,
    BoolArray,
    ComplexArray,
    Entries,
    Float32Array,
    FloatArray,
    IntArray,
)

_OWN = 0.6  # share of the lane's own clutter where it stands in for what was learnt, as in fused3
_LEAST = 0.1  # the map stays positive, so that it can be drawn as a magnitude
_DARK = 0.05  # of the background's power: a darker chip counts no more
_LIKELY = 0.1  # of the chips of a scan, those most like a mine, are no clutter of the lane
# Log odds of a mine over a stone by the difference of their log-likelihoods: a logistic regression,
# docs/reference/likelihood.md.
_RIVAL = (0.32, -0.87)


class LikelihoodSettings(Table):
    """What is looked for, and how; lengths in m.

    Signatures are those of bodies of these ``kinds``, their tops at ``depths``, in ``soils``
    (permittivity, loss tangent), ``copies`` of each over all distances, as ``sensor`` sees them: a
    preset or a file that describes the run's array, or "run", the array of the run itself with the
    pattern, tilt and errors of the antennas of another sensor, ``antennas``. Chips are 3 x 3 pixels
    ``step`` apart. Clutter is learnt beyond ``clear`` of all targets. ``rank`` is the number of
    signature vectors, ``load`` the share of the mean power that is added to the covariance's
    diagonal, ``ratios`` are the powers of a signature in whitened clutter over which the likelihood
    is averaged. ``own`` is the share of the lane's own clutter in the covariance; the rest is that
    of the training lanes.

    The contrast of these ``polarizations``, the power over the half width ``inner`` against that of
    the ring from ``guard`` to ``outer``, dB, is added ``level`` times. ``blur`` is the standard
    deviation of the map's smoothing, ``offset`` lifts it.
    """

    sensor: str
    antennas: str = ""
    kinds: tuple[str, ...] = Field(("metal",), min_length=1)
    depths: tuple[NotNegative, ...] = Field((0.0, 0.05, 0.1, 0.15), min_length=1)
    soils: tuple[tuple[Annotated[float, Field(ge=1)], NotNegative], ...] = Field(
        ((2.7, 0.01), (4.0, 0.02), (6.0, 0.05), (9.0, 0.1), (14.0, 0.15)), min_length=1
    )
    copies: Annotated[int, Field(ge=1, le=10_000)] = 24
    step: Spacing = 0.2
    clear: Positive = 1.2
    rank: AtLeastOne = 12
    load: Positive = 1e-3
    own: Annotated[float, Field(ge=0, lt=1)] = 0.0
    ratios: tuple[Positive, ...] = Field((3.0, 10.0, 30.0, 100.0, 300.0, 1000.0), min_length=1)
    level: NotNegative = 2.0
    polarizations: tuple[str, ...] = Field(("HH", "VV"), min_length=1)
    inner: Positive = 0.15
    guard: Positive = 0.65
    outer: Positive = 1.55
    blur: Annotated[float, Field(ge=0, le=10)] = 0.15
    offset: Positive = 40.0

    @model_validator(mode="after")
    def _antennas_of_run(self) -> LikelihoodSettings:
        """Refuse antennas of a sensor that has its own, and none of a run, which has none."""
        if (self.sensor == OWN_ARRAY) != bool(self.antennas):
            raise ValueError(
                f"antennas must name a sensor with sensor = {OWN_ARRAY!r} and only then, "
                f"got {self.antennas!r} with sensor = {self.sensor!r}"
            )
        return self

    @model_validator(mode="after")
    def _nested(self) -> LikelihoodSettings:
        """Refuse regions of the contrast that do not enclose one another."""
        if not self.inner < self.guard < self.outer:
            raise ValueError(
                f"inner, guard and outer must rise, got {self.inner:g}, {self.guard:g} and "
                f"{self.outer:g}"
            )
        return self


class _Group(NamedTuple):
    """Names of the arrays of one group of simulated bodies."""

    signature: str  # learnt: vectors
    share: str  # learnt: their shares of the power
    chips: str  # examples: chips of the bodies
    ahead: str  # examples: how far ahead each lies


_MINES = _Group("signature", "share", "bodies", "ahead")
_STONES = _Group("stone", "stone_share", "stones", "stones_ahead")


class LikelihoodMap(MapStage):
    r"""Log-likelihood ratio of every look at a pixel, mine against none, in textured clutter.

    The clutter is compound-Gaussian. Of a look, x holds the pixel's chip in all d polarizations,
    sub-bands and pixels. Without a mine it is CN(0, τR), with a texture τ that nobody knows; with
    one it is CN(0, τ(R + γS)), where S is the mean of s s^H over signatures of unit power in
    clutter whitened by R. With the likeliest τ of either,

    .. math:: \ln Λ_γ = -d \ln \frac{x^H (R + γS)^{-1} x}{x^H R^{-1} x} - \ln \det(I + γ R^{-1} S),

    of which the mean of Λ over the powers γ is taken. For a single signature and γ to infinity it
    is the normalised matched filter of Conte, Lops & Ricci, "Asymptotically optimum radar detection
    in compound-Gaussian clutter", IEEE Trans. Aerosp. Electron. Syst. 31 (1995); the powers and the
    subspace are ours. R is learnt by metre ahead, every chip over its own power; S rests on no
    measured mine. The looks' mean is the run-view's, ``look = "mean"``.

    With ``own`` = a, R is (1 - a) R of the training lanes + a R of the lane itself, which is of
    unit power, too. It is of the chips in the lane, of a metre and of those before and after it, but
    for the tenth of every scan that is most like a mine. S stays that of the training lanes.
    """

    learns = True
    single = False
    measures_clutter = True
    Settings: ClassVar[type[Table]] = LikelihoodSettings

    def __init__(self, settings: Any, setup: Setup, learnt: Arrays | None = None) -> None:
        super().__init__(settings, setup, learnt)
        grid = setup.images
        self._metres = _metres_of(grid)
        rows_apart = max(1, round(settings.step / grid.dy))
        columns_apart = max(1, round(settings.step / grid.dx))
        self._rows = np.arange(rows_apart, grid.ny - rows_apart, rows_apart)
        self._columns = np.arange(columns_apart, grid.nx - columns_apart, columns_apart)
        ahead = (grid.y[self._rows] - grid.y_min).astype(np.int64)
        self._metre = np.clip(ahead, 0, self._metres - 1)  # of each of these rows
        if not len(self._rows) or not len(self._columns):
            raise ValueError(
                f"map.step must leave pixels within an image's borders, got {settings.step:g}"
            )
        chip = np.mgrid[-1:2, -1:2].reshape(2, -1)
        self._down = chip[0] * rows_apart
        self._across = chip[1] * columns_apart
        self._between_rows = _between(self._rows, grid.ny)
        self._between_columns = _between(self._columns, grid.nx).T
        self._bands: dict[tuple[int, int], SomeValues] = {}
        self._grounds: dict[tuple[int, str], WhitenedGround] = {}

    @classmethod
    def check_learnt(cls, settings: Any, setup: Setup, learnt: Checked) -> None:
        """Check what whitens a chip, and vectors and shares of the signatures, by metre ahead."""
        metres = _metres_of(setup.images)
        size = 9 * len(setup.imaged) * len(setup.imager.subbands)
        learnt.array("whitener", (metres, size, size), np.complex64)
        for group in (_MINES, _STONES):
            if group is _STONES and not learnt.has(group.signature):
                continue
            rank = learnt.array(group.share, (metres, None)).shape[1]
            if rank > settings.rank:
                raise ValueError(
                    f"array {group.share!r} must have at most {settings.rank}, got {rank}"
                )
            learnt.array(group.signature, (metres, rank, size), np.complex64)

    @classmethod
    def why_not_live(cls, settings: Any) -> str:
        """Return why it cannot work while scans come in; "" if it can."""
        if settings.own:
            return "it compares with the clutter of the whole lane"
        return cls.not_live_because

    @property
    def surveys(self) -> bool:
        """Whether it learns the clutter of the lane before its first map."""
        return bool(self.settings.own)

    def survey(self, image: Callable[[int], xr.DataArray]) -> Accumulator:
        """Return what sums the covariance of the lane's own clutter, by metre ahead.

        Every chip is over its own power. The tenth of the chips of a scan and a metre that is most
        like a mine by the training lanes' clutter is left out.
        """
        sums = self._no_sums()

        def add(index: int) -> None:
            of_scan = self._ordinary(image(index))
            for number, some in of_scan.items():
                self._add_clutter(sums, number, some)

        return sum_accumulator(sums, add)

    def _ordinary(self, scan_image: xr.DataArray) -> dict[int, ComplexArray]:
        """Return the chips (chip, value) in the lane by metre, without those most like a mine."""
        _, in_lane = self._places(scan_image)
        chips = self._chips(scan_image.values)
        ordinary = {}
        for number in np.unique(self._metre):
            some = chips[in_lane & (self._metre == number)[:, None]]
            if not len(some):
                continue
            ground = self._learnt_ground(int(number))
            likelihood = self._ratio(some @ ground.whitener.T, ground, _MINES)
            ordinary[int(number)] = some[likelihood <= np.quantile(likelihood, 1 - _LIKELY)]
        return ordinary

    def clutter_of(self, image: xr.DataArray) -> Arrays:
        """Return the sums of a scan's own clutter, without its chips most like a mine, by metre.

        They are the ``covariance`` of chips over their own power, as of :meth:`survey`, their
        ``count``, and ``shape`` (metre, class): the chips by the power that whitening by the
        training lanes' clutter leaves of them, in the classes of ``SHAPES``.
        """
        sums = self._no_sums() | {"shape": np.zeros((self._metres, len(SHAPES) + 1))}
        for number, some in self._ordinary(image).items():
            self._add_clutter(sums, number, some)
            sums["shape"][number] = shape_counts(some, self.learnt["whitener"][number], _DARK)
        return sums

    def map(self, image: xr.DataArray) -> Float32Array:
        """Return the log-likelihood ratio (y, x) with the contrast and ``offset`` added.

        Where it stands in for what was learnt, the lane's own clutter is in the covariance.
        """
        return self._map(image, self.substitute())

    def map_as_learnt(self, image: xr.DataArray) -> Float32Array:
        """Return the map as it is where nothing stands in for what was learnt."""
        return self._map(image, "")

    def _map(self, image: xr.DataArray, substitute: str) -> Float32Array:
        """Return the map with what stands in for what was learnt."""
        table = self.settings
        total = self._likelihood(image, substitute) + table.offset
        if table.level:
            contrast = contrasts(self._contrast_channels(image), table)
            total += table.level * contrast.mean(axis=(0, 1))
        smooth = gaussian_filter(total, self._blur, mode="nearest")
        return np.asarray(np.maximum(smooth, _LEAST), dtype=np.float32)

    def _likelihood(self, image: xr.DataArray, substitute: str) -> FloatArray:
        """Return the log-likelihood ratio (y, x) of an image."""
        chips = self._chips(image.values)
        value = np.empty(chips.shape[:2])
        for number in np.unique(self._metre):
            ground = self._ground(int(number), substitute)
            white = chips[self._metre == number] @ ground.whitener.T
            value[self._metre == number] = self._ratio(white, ground, _MINES)
        return self._interpolated(value)

    def parts(self, image: xr.DataArray) -> tuple[Arrays, Arrays]:
        """Return what explains the map, as maps (y, x) by name.

        Returns
        -------
        adding : dict of str to ndarray
            What the likelihood and the contrast of each polarization add. They add up to the map
            without ``offset``, except where it was cut off at the least value.
        others : dict of str to ndarray
            The log-likelihood ratio of each sub-band by itself, and the log odds of a mine over a
            stone, were both as frequent.
        """
        table = self.settings
        substitute = self.substitute()
        chips = self._chips(image.values)
        subbands = [str(name) for name in image["subband"].values]
        rows: dict[str, list[FloatArray]] = {}
        for number in np.unique(self._metre):
            of_metre = chips[self._metre == number]
            ratios = self._ratios(of_metre, int(number), subbands, substitute)
            for name, value in ratios.items():
                rows.setdefault(name, []).append(value)
        maps = {}
        for name, values in rows.items():
            maps[name] = self._interpolated(np.concatenate(values))

        adding = {"likelihood": maps.pop("likelihood")}
        contrast = table.level * contrasts(self._contrast_channels(image), table).mean(axis=1)
        for label, of_polarization in zip(table.polarizations, contrast, strict=True):
            adding[f"contrast {label}"] = of_polarization / len(table.polarizations)
        return self._smooth(adding), self._smooth(maps)

    def _ratios(
        self, chips: ComplexArray, metre: int, subbands: Sequence[str], substitute: str
    ) -> dict[str, FloatArray]:
        """Return all log-likelihood ratios of the chips of a metre, by name.

        Those of a sub-band alone are by the clutter of the training lanes.
        """
        ground = self._ground(metre, substitute)
        white = chips @ ground.whitener.T
        ratios = {"likelihood": self._ratio(white, ground, _MINES)}
        for number, name in enumerate(subbands):
            band = self._band(metre, number, len(subbands))
            band_white = chips[..., band.values] @ band.whitener.T
            ratios[name] = ratio(band_white, band.vectors, band.share, self.settings.ratios)
        if _STONES.signature in ground.signatures:
            stone = self._ratio(white, ground, _STONES)
            ratios["mine over stone"] = _RIVAL[0] * (ratios["likelihood"] - stone) + _RIVAL[1]
        return ratios

    def _ratio(self, white: ComplexArray, ground: WhitenedGround, group: _Group) -> FloatArray:
        """Return the log-likelihood ratio of whitened chips of a metre, for a group of bodies."""
        vectors, share = ground.signatures[group.signature]
        return ratio(white, vectors, share, self.settings.ratios)

    def _ground(self, metre: int, substitute: str = "") -> WhitenedGround:
        """Return what the chips of a metre are compared with."""
        if (metre, substitute) not in self._grounds:
            ground = self._learnt_ground(metre)
            if substitute == "own":
                share = max(self.settings.own, _OWN)
                ground = self._adapted(ground, metre, "unlike", share)
            elif self.settings.own:
                ground = self._adapted(ground, metre, "survey", self.settings.own)
            self._grounds[metre, substitute] = ground
        return self._grounds[metre, substitute]

    def _learnt_ground(self, metre: int) -> WhitenedGround:
        """Return what was learnt of a metre on the training lanes."""
        signatures = {}
        for group in (_MINES, _STONES):
            if group.signature in self.learnt:
                vectors = self.learnt[group.signature][metre]
                signatures[group.signature] = (vectors, self.learnt[group.share][metre])
        return WhitenedGround(self.learnt["whitener"][metre], signatures)

    def _adapted(
        self, ground: WhitenedGround, metre: int, measured: str, share: float
    ) -> WhitenedGround:
        """Return the ground of a metre with a share of the lane's own clutter, by a pass's name."""
        near = slice(max(metre - 1, 0), metre + 2)
        covariance = self.setup.results[measured]["covariance"]
        by_metre = covariance.reshape(-1, *covariance.shape[-3:]).sum(axis=0)
        return ground.with_clutter(by_metre[near].sum(axis=0), share, self.settings.load)

    def _interpolated(self, value: FloatArray) -> FloatArray:
        """Return values at the middles of chips, interpolated to all pixels."""
        return np.asarray(self._between_rows @ value @ self._between_columns)

    def _contrast_channels(self, image: xr.DataArray) -> xr.DataArray:
        """Return the polarizations of an image whose contrast is added."""
        return image.sel(polarization=list(self.settings.polarizations))

    @property
    def _blur(self) -> tuple[float, float]:
        """Standard deviations (y, x) of the smoothing, pixels."""
        grid = self.setup.images
        return self.settings.blur / grid.dy, self.settings.blur / grid.dx

    def _smooth(self, maps: Arrays) -> Arrays:
        """Smooth maps as the map is smoothed."""
        return {
            name: gaussian_filter(values, self._blur, mode="nearest")
            for name, values in maps.items()
        }

    def _band(self, metre: int, number: int, bands: int) -> SomeValues:
        """Return what the chips of a sub-band are compared with at a metre, by its number."""
        if (metre, number) not in self._bands:
            ground = self._learnt_ground(metre)
            # Values go through polarization, sub-band and pixel.
            values = np.flatnonzero(np.arange(len(ground.whitener)) // 9 % bands == number)
            self._bands[metre, number] = ground.of_values(values, _MINES.signature)
        return self._bands[metre, number]

    def examples(self, truth: pd.DataFrame, image: Callable[[int], xr.DataArray]) -> Accumulator:
        """Return what sums the covariance of target-free ground, and simulates the signatures.

        Signatures are in units of this lane's background.
        """
        targets = truth[["x", "y"]].to_numpy(dtype=np.float64)
        sensor = sensor_of(self.setup, self.settings.sensor, self.settings.antennas)
        sums = self._no_sums()

        def add(index: int) -> None:
            scan_image = image(index)
            ground, in_lane = self._places(scan_image)
            distances = np.linalg.norm(ground[..., None, :] - targets, axis=-1)
            to_target = distances.min(axis=-1, initial=np.inf)
            free = in_lane & (to_target > self.settings.clear)
            chips = self._chips(scan_image.values)
            for number in np.unique(self._metre[free.any(axis=1)]):
                at_metre = free & (self._metre == number)[:, None]
                self._add_clutter(sums, int(number), chips[at_metre])

        return sum_accumulator(sums, add, lambda: sums | self._simulated(sensor))

    @classmethod
    def fit(cls, settings: Any, examples: list[Any]) -> tuple[Arrays, Entries]:
        """Learn what whitens the clutter of all lanes, and the signatures' directions in it.

        Both are learnt by metre ahead.
        """
        total, count = summed_clutter(examples)
        size = total.shape[-1]
        if count.sum() < size:
            needed = f"{size} places of target-free ground or more, got {count.sum():g}"
            free = Tally(int(count.sum()), "places in the lane away from all targets")
            raise TooFewExamplesError(needed, [free], [clear_change(settings)])

        learnt: dict[str, list[Any]] = defaultdict(list)
        chips = {}
        ahead = {}
        for group in (_MINES, _STONES):
            chips[group] = np.concatenate([lane[group.chips] for lane in examples])
            ahead[group] = np.concatenate([lane[group.ahead] for lane in examples])
        for metre in range(len(count)):
            white = clutter_whitener(total, count, metre, settings.load)
            learnt["whitener"].append(white)
            for group in (_MINES, _STONES):
                bodies = chips[group]
                nearest = np.argsort(np.abs(ahead[group] - metre - 0.5), kind="stable")
                most = max(3 * len(bodies) // len(count), settings.rank)
                vectors, share = principal_directions(bodies[nearest[:most]] @ white.T)
                learnt[group.signature].append(vectors[: settings.rank])
                learnt[group.share].append(share[: settings.rank])

        power_in_vectors = np.sum(learnt[_MINES.share], axis=1)
        notes = {
            "ground": int(count.sum()),
            "signatures": len(chips[_MINES]),
            "kept": float(power_in_vectors.mean()),
        }
        arrays = {}
        for name, by_metre in learnt.items():
            array = np.array(by_metre)
            arrays[name] = array.astype(np.complex64) if np.iscomplexobj(array) else array
        return arrays, notes

    @classmethod
    def without_lane(
        cls, settings: Any, learnt: Arrays, examples: list[Any], number: int
    ) -> Arrays:
        """Return what was learnt with the clutter of all training lanes but one.

        The directions of the signatures stay those of all: here they only tell what is most like a
        mine.
        """
        total, count = summed_clutter([*examples[:number], *examples[number + 1 :]])
        if count.sum() < total.shape[-1]:
            return learnt
        whitener = [clutter_whitener(total, count, m, settings.load) for m in range(len(count))]
        return learnt | {"whitener": np.array(whitener).astype(np.complex64)}

    def _no_sums(self) -> Arrays:
        """Return the empty sums of a covariance by metre ahead."""
        size = 9 * len(self.setup.imaged) * len(self.setup.imager.subbands)
        return {
            "covariance": np.zeros((self._metres, size, size), complex),
            "count": np.zeros(self._metres),
        }

    def _add_clutter(self, sums: Arrays, metre: int, chips: ComplexArray) -> None:
        """Add chips (chip, value) of a metre to the sums, each over its own power."""
        samples = chips.astype(complex)
        power = (np.abs(samples) ** 2).mean(axis=1, keepdims=True)
        samples /= np.sqrt(np.maximum(power, _DARK))
        sums["covariance"][metre] += samples.T @ samples.conj()
        sums["count"][metre] += len(samples)

    def _places(self, image: xr.DataArray) -> tuple[FloatArray, BoolArray]:
        """Return where the chips (row, column) of an image lie, m, and whether in the lane."""
        grid = self.setup.images
        ahead, across = np.meshgrid(grid.y[self._rows], grid.x[self._columns], indexing="ij")
        pixels = np.stack([across, ahead, np.zeros_like(ahead)], axis=-1)
        ground = scan_to_lane(pixels, np.asarray(image.attrs["pose"]))[..., :2]
        return ground, self.setup.lane.contains(ground[..., 0], ground[..., 1])

    def _chips(self, image: ComplexArray) -> ComplexArray:
        """Cut all chips (row, column, value) out of an image.

        Values go through polarization, sub-band and pixel.
        """
        rows = self._rows[:, None, None] + self._down
        columns = self._columns[:, None] + self._across
        cut = np.moveaxis(image[:, :, rows, columns], (2, 3), (0, 1))
        return cut.reshape(*cut.shape[:2], -1)

    def _simulated(self, sensor: Sensor) -> Arrays:
        """Return chips (body, value) of simulated bodies, and how far ahead each lies.

        They are in units of this lane's background.
        """
        grid = self.setup.images
        table = self.settings
        background = self.setup.results["gain"]
        imaging = self._imaging()
        arrays: Arrays = {}
        for group, kinds in ((_MINES, table.kinds), (_STONES, ())):
            bodies = Bodies(kinds, table.depths, table.soils, table.copies, table.step)
            raw, places = signatures(bodies, sensor, imaging)
            row, column = pixels_at(grid, *places.T)
            gain = np.moveaxis(background["gain"][:, :, row, column], 2, 0)
            level = gain * background["gains"].mean(axis=0)
            chips = (raw / level[..., None]).reshape(len(raw), -1)
            arrays[group.chips] = chips.astype(np.complex64)
            arrays[group.ahead] = places[:, 1] - grid.y_min
        return arrays

    def _imaging(self) -> Imaging:
        """Return how simulated bodies are imaged: as the run is."""
        setup = self.setup
        grid = setup.images
        pixels = tuple(zip(self._across * grid.dx, self._down * grid.dy, strict=True))
        left = max(grid.x_min, setup.lane.x_min)
        right = min(grid.extent()[1], setup.lane.x_max)
        return Imaging(
            grid=grid,
            subbands=tuple(setup.imager.subbands.items()),
            polarizations=tuple(imaged_labels(setup)),
            window=window_of(setup.imager),
            tolerance=setup.imager.tolerance,
            pixels=pixels,
            limits=(left, right),
            tones=tuple(setup.run["frequency"].values.tolist()),
        )


def contrasts(image: xr.DataArray, table: LikelihoodSettings) -> Float32Array:
    """Compute the contrast of every pixel of an image to the ring about it.

    Parameters
    ----------
    image : (polarization, subband, y, x) DataArray of complex
        Cleaned scan image.
    table : LikelihoodSettings
        Half widths of the regions.

    Returns
    -------
    (polarization, subband, y, x) ndarray
        dB.
    """
    power = np.abs(image.values) ** 2
    steps = [float(image[axis].values[1] - image[axis].values[0]) for axis in "yx"]

    def mean(half: float) -> tuple[Any, float]:
        """Return the mean power over a square of a half width, and its number of pixels."""
        size = tuple(2 * round((half - step / 2) / step) + 1 for step in steps)
        return uniform_filter(power, (1, 1, *size), mode="nearest"), float(np.prod(size))

    inner, _ = mean(table.inner)
    guard, guard_pixels = mean(table.guard)
    outer, outer_pixels = mean(table.outer)
    ring = (outer_pixels * outer - guard_pixels * guard) / (outer_pixels - guard_pixels)
    tiny = np.finfo(np.float32).tiny
    contrast = 10 * np.log10(np.maximum(inner, tiny) / np.maximum(ring, tiny))
    return np.asarray(contrast, dtype=np.float32)


def _metres_of(images: Grid) -> int:
    """Return the number of metres ahead that scan images reach over, begun ones included."""
    return max(1, math.ceil(images.extent()[3] - images.y_min))


def _between(pixels: IntArray, count: int) -> FloatArray:
    """Return the matrix (count, pixel) that interpolates linearly between pixels.

    Before the first and beyond the last the value is theirs.
    """
    columns = [np.interp(np.arange(count), pixels, row) for row in np.eye(len(pixels))]
    return np.stack(columns, axis=1)
