"""A map of how much likelier a look is with a mine under it: signatures of simulated bodies against learnt clutter."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Annotated, Any, ClassVar, NamedTuple

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray
from pydantic import Field, model_validator
from scipy.ndimage import gaussian_filter, uniform_filter
from scipy.special import logsumexp

from flgpr.chain.engine import Accumulator, Arrays, sum_accumulator
from flgpr.chain.stages import ComplexArray, FloatArray, MapStage, Positive, Setup, Table
from flgpr.chain.too_few import Tally, TooFewExamplesError, clear_change
from flgpr.detect.scorers.checks import Checked
from flgpr.imaging import ScanImager
from flgpr.model import Grid, Sensor, lane_to_scan, load_sensor, scan_to_lane
from flgpr.model.bounds import Spacing
from flgpr.simulate import ALONE, BARE, Scene, Simulator

_LEAST = 0.1  # the map stays positive, so that it can be drawn as a magnitude
_APART = 100.0  # m between simulated bodies: a scan sees no farther
_TILT = math.radians(4)  # rms in each axis, as mines are laid
_DARK = 0.05  # of the background's power: a darker chip counts no more
_SEED = 2026
# Log odds of a mine over a stone by the difference of their log-likelihoods: a logistic regression,
# docs/fused.md.
_RIVAL = (0.32, -0.87)
_STONES = (0.04, 0.12)  # m, radii of stones: smaller ones are seldom seen


class LikelihoodSettings(Table):
    """What is looked for, and how; lengths in m.

    Signatures are those of bodies of these ``kinds``, their tops at ``depths``, in ``soils``
    (permittivity, loss tangent), ``copies`` of each over all distances, as ``sensor`` sees them: a
    preset or a file that describes the run's array. Chips are 3 x 3 pixels ``step`` apart. Clutter
    is learnt beyond ``clear`` of all targets. ``rank`` is the number of signature vectors, ``load``
    the share of the mean power that is added to the covariance's diagonal, ``ratios`` are the
    powers of a signature in whitened clutter over which the likelihood is averaged. The contrast of
    these ``polarizations``, the power over the half width ``inner`` against that of the ring from
    ``guard`` to ``outer``, dB, is added ``level`` times. ``blur`` is the standard deviation of the
    map's smoothing, ``offset`` lifts it.
    """

    sensor: str
    kinds: tuple[str, ...] = Field(("metal",), min_length=1)
    depths: tuple[Annotated[float, Field(ge=0)], ...] = Field((0.0, 0.05, 0.1, 0.15), min_length=1)
    soils: tuple[tuple[Annotated[float, Field(ge=1)], Annotated[float, Field(ge=0)]], ...] = Field(
        ((2.7, 0.01), (4.0, 0.02), (6.0, 0.05), (9.0, 0.1), (14.0, 0.15)), min_length=1
    )
    copies: Annotated[int, Field(ge=1, le=10_000)] = 24
    step: Spacing = 0.2
    clear: Positive = 1.2
    rank: Annotated[int, Field(ge=1)] = 12
    load: Positive = 1e-3
    ratios: tuple[Positive, ...] = Field((3.0, 10.0, 30.0, 100.0, 300.0, 1000.0), min_length=1)
    level: Annotated[float, Field(ge=0)] = 2.0
    polarizations: tuple[str, ...] = Field(("HH", "VV"), min_length=1)
    inner: Positive = 0.15
    guard: Positive = 0.65
    outer: Positive = 1.55
    blur: Annotated[float, Field(ge=0, le=10)] = 0.15
    offset: Positive = 40.0

    @model_validator(mode="after")
    def _nested(self) -> LikelihoodSettings:
        if not self.inner < self.guard < self.outer:
            raise ValueError(
                f"inner, guard and outer must rise, got {self.inner:g}, {self.guard:g} and "
                f"{self.outer:g}"
            )
        return self


class LikelihoodMap(MapStage):
    r"""Log-likelihood ratio of every look at a pixel, mine against none, in compound-Gaussian clutter.

    Of a look, x holds the pixel's chip in all d polarizations, sub-bands and pixels. Without a mine
    it is CN(0, τR), with a texture τ that nobody knows; with one it is CN(0, τ(R + γS)), where S is
    the mean of s s^H over signatures of unit power in clutter whitened by R. With the likeliest τ
    of either,

    .. math:: \ln Λ_γ = -d \ln \frac{x^H (R + γS)^{-1} x}{x^H R^{-1} x} - \ln \det(I + γ R^{-1} S),

    of which the mean of Λ over the powers γ is taken. For a single signature and γ to infinity it
    is the normalised matched filter of Conte, Lops & Ricci, "Asymptotically optimum radar detection
    in compound-Gaussian clutter", IEEE Trans. Aerosp. Electron. Syst. 31 (1995); the powers and the
    subspace are ours. R is learnt by metre ahead, every chip over its own power; S rests on no
    measured mine. The looks' mean is the run-view's, ``look = "mean"``.
    """

    learns = True
    single = False
    Settings: ClassVar[type[Table]] = LikelihoodSettings

    def __init__(self, settings: Any, setup: Setup, learnt: Arrays | None = None) -> None:
        super().__init__(settings, setup, learnt)
        grid = setup.images
        self._metres = _metres_of(grid)
        down, across = (max(1, round(settings.step / each)) for each in (grid.dy, grid.dx))
        self._rows, self._columns = (
            np.arange(each, count - each, each)
            for each, count in ((down, grid.ny), (across, grid.nx))
        )
        if not len(self._rows) or not len(self._columns):
            raise ValueError(
                f"map.step must leave pixels within an image's borders, got {settings.step:g}"
            )
        chip = np.mgrid[-1:2, -1:2].reshape(2, -1)
        self._down = chip[0] * down
        self._across = chip[1] * across
        self._between = _between(self._rows, grid.ny), _between(self._columns, grid.nx).T
        self._bands: dict[
            tuple[int, int], tuple[NDArray[np.intp], ComplexArray, ComplexArray, FloatArray]
        ] = {}

    @classmethod
    def check_learnt(cls, settings: Any, setup: Setup, learnt: Checked) -> None:
        """Take, by metre ahead, what whitens a chip, and directions and shares of the signatures."""
        metres = _metres_of(setup.images)
        size = 9 * len(setup.imaged) * len(setup.imager.subbands)
        learnt.array("whitener", (metres, size, size), np.complex64)
        for signature, share in (("signature", "share"), ("stone", "stone_share")):
            if signature == "stone" and not learnt.has(signature):
                continue
            rank = learnt.array(share, (metres, None)).shape[1]
            if rank > settings.rank:
                raise ValueError(f"array {share!r} must have at most {settings.rank}, got {rank}")
            learnt.array(signature, (metres, rank, size), np.complex64)

    def map(self, image: xr.DataArray) -> NDArray[np.float32]:
        """Return the log-likelihood ratio with the contrast and ``offset`` added."""
        table = self.settings
        learnt = self.learnt
        chips = self._chips(image.values)
        metre = self._metre(self.setup.images.y[self._rows])
        value = np.empty(chips.shape[:2])
        for one in np.unique(metre):
            white = chips[metre == one] @ learnt["whitener"][one].T
            value[metre == one] = ratio(
                white, learnt["signature"][one], learnt["share"][one], table.ratios
            )
        total = self._between[0] @ value @ self._between[1] + table.offset
        if table.level:
            total += table.level * contrasts(
                image.sel(polarization=list(table.polarizations)), table
            ).mean(axis=(0, 1))
        grid = self.setup.images
        total = gaussian_filter(total, (table.blur / grid.dy, table.blur / grid.dx), mode="nearest")
        return np.asarray(np.maximum(total, _LEAST), dtype=np.float32)

    def parts(self, image: xr.DataArray) -> tuple[Arrays, Arrays]:
        """Return what the likelihood and each polarization's contrast add; alone, what sub-bands and a stone would say.

        That is each sub-band's log-likelihood ratio, and the log odds of a mine over a stone, were
        both as frequent. Parts add up to the map without ``offset``, but where that was cut off at
        the least value.
        """
        table = self.settings
        learnt = self.learnt
        grid = self.setup.images
        chips = self._chips(image.values)
        metre = self._metre(grid.y[self._rows])
        bands = [str(name) for name in image["subband"].values]
        values: dict[str, list[FloatArray]] = {}
        for one in np.unique(metre):
            some = chips[metre == one]
            white = some @ learnt["whitener"][one].T
            found = {
                "likelihood": ratio(
                    white, learnt["signature"][one], learnt["share"][one], table.ratios
                )
            }
            for number, name in enumerate(bands):
                own, whitener, vectors, share = self._band(int(one), number, len(bands))
                found[name] = ratio(some[..., own] @ whitener.T, vectors, share, table.ratios)
            if "stone" in learnt:
                stone = ratio(white, learnt["stone"][one], learnt["stone_share"][one], table.ratios)
                found["mine over stone"] = _RIVAL[0] * (found["likelihood"] - stone) + _RIVAL[1]
            for name, value in found.items():
                values.setdefault(name, []).append(value)
        maps = {
            name: self._between[0] @ np.concatenate(some) @ self._between[1]
            for name, some in values.items()
        }
        adds = {"likelihood": maps.pop("likelihood")}
        contrast = table.level * contrasts(
            image.sel(polarization=list(table.polarizations)), table
        ).mean(axis=1)
        for label, one_label in zip(table.polarizations, contrast, strict=True):
            adds[f"contrast {label}"] = one_label / len(table.polarizations)
        blur = table.blur / grid.dy, table.blur / grid.dx

        def smooth(some: Arrays) -> Arrays:
            return {name: gaussian_filter(one, blur, mode="nearest") for name, one in some.items()}

        return smooth(adds), smooth(maps)

    def _band(
        self, metre: int, number: int, bands: int
    ) -> tuple[NDArray[np.intp], ComplexArray, ComplexArray, FloatArray]:
        """Return a sub-band's places in a chip, what whitens it there, and its signatures' vectors and shares."""
        if (metre, number) not in self._bands:
            whitener = self.learnt["whitener"][metre]
            vectors = self.learnt["signature"][metre]
            own = np.flatnonzero(np.arange(len(whitener)) // 9 % bands == number)
            back = np.linalg.inv(whitener.astype(complex))
            white = np.linalg.inv(np.linalg.cholesky((back @ back.conj().T)[np.ix_(own, own)]))
            strong = vectors.conj().T * np.sqrt(self.learnt["share"][metre])
            left, strength, _ = np.linalg.svd(white @ (back @ strong)[own], full_matrices=False)
            self._bands[metre, number] = (
                own,
                _single(white),
                _single(left.T.conj()),
                strength**2 / (strength**2).sum(),
            )
        return self._bands[metre, number]

    def examples(self, truth: pd.DataFrame, image: Callable[[int], xr.DataArray]) -> Accumulator:
        """Sum the covariance of target-free ground; simulate the signatures, in units of this lane's background."""
        grid = self.setup.images
        lane = self.setup.lane
        targets = truth[["x", "y"]].to_numpy(dtype=np.float64)
        ahead, across = np.meshgrid(grid.y[self._rows], grid.x[self._columns], indexing="ij")
        pixels = np.stack([across, ahead, np.zeros_like(ahead)], axis=-1)
        metre = self._metre(ahead)
        size = 9 * len(self.setup.imaged) * len(self.setup.imager.subbands)
        sensor = _sensor_of(self.setup, self.settings.sensor)
        sums: Arrays = {
            "covariance": np.zeros((self._metres, size, size), complex),
            "count": np.zeros(self._metres),
        }

        def add(index: int) -> None:
            one = image(index)
            where = scan_to_lane(pixels, np.asarray(one.attrs["pose"]))[..., :2]
            off = np.linalg.norm(where[..., None, :] - targets, axis=-1).min(
                axis=-1, initial=np.inf
            )
            free = lane.contains(where[..., 0], where[..., 1]) & (off > self.settings.clear)
            chips = self._chips(one.values)
            for m in np.unique(metre[free]):
                some = chips[free & (metre == m)].astype(complex)
                some /= np.sqrt(np.maximum((np.abs(some) ** 2).mean(axis=1, keepdims=True), _DARK))
                sums["covariance"][m] += some.T @ some.conj()
                sums["count"][m] += len(some)

        return sum_accumulator(sums, add, lambda: sums | self._bodies(sensor))

    @classmethod
    def fit(cls, settings: Any, examples: list[Any]) -> tuple[Arrays, dict[str, Any]]:
        """Learn, by metre ahead, what whitens the clutter of all lanes, and the signatures' directions in it."""
        total, count = (
            np.sum([lane[name] for lane in examples], axis=0) for name in ("covariance", "count")
        )
        sorts = {
            names: [np.concatenate([lane[name] for lane in examples]) for name in told]
            for names, told in (
                (("signature", "share"), ("bodies", "ahead")), (("stone", "stone_share"), ("stones", "stones_ahead"))
            )
        }  # fmt: skip
        size = total.shape[-1]
        metres = np.arange(len(count))
        if count.sum() < size:
            needed = f"{size} places of target-free ground or more, got {count.sum():g}"
            free = Tally(int(count.sum()), "places in the lane away from all targets")
            raise TooFewExamplesError(needed, [free], [clear_change(settings)])
        learnt: dict[str, list[Any]] = {
            "whitener": [],
            **{name: [] for names in sorts for name in names},
        }
        for metre in metres:
            reach = next(
                r
                for r in range(1, len(count) + 1)
                if count[np.abs(metres - metre) <= r].sum() >= size
            )
            covariance = total[np.abs(metres - metre) <= reach].sum(axis=0)
            covariance *= size / np.trace(covariance).real
            white = np.linalg.inv(np.linalg.cholesky(covariance + settings.load * np.eye(size)))
            learnt["whitener"].append(white)
            for (signature, share), (bodies, ahead) in sorts.items():
                nearest = np.argsort(np.abs(ahead - metre - 0.5), kind="stable")
                some = (
                    bodies[nearest[: max(3 * len(bodies) // len(count), settings.rank)]] @ white.T
                )
                some /= np.linalg.norm(some, axis=1, keepdims=True)
                _, strength, vectors = np.linalg.svd(some, full_matrices=False)
                learnt[signature].append(vectors[: settings.rank].conj())
                learnt[share].append((strength**2 / (strength**2).sum())[: settings.rank])
        kept = np.sum(learnt["share"], axis=1)
        number = len(sorts["signature", "share"][0])
        notes = {"ground": int(count.sum()), "signatures": number, "kept": float(kept.mean())}
        arrays = {name: np.array(some) for name, some in learnt.items()}
        return {
            name: one.astype(np.complex64) if np.iscomplexobj(one) else one
            for name, one in arrays.items()
        }, notes

    def _metre(self, y: NDArray[Any]) -> NDArray[np.int64]:
        """Tally whole metres from the image's near border."""
        return np.clip((y - self.setup.images.y_min).astype(np.int64), 0, self._metres - 1)

    def _chips(self, image: ComplexArray) -> ComplexArray:
        """Cut all chips (row, column, value) of an image; values go through polarization, sub-band and pixel."""
        rows, columns = (
            self._rows[:, None, None] + self._down,
            self._columns[:, None] + self._across,
        )
        cut = np.moveaxis(image[:, :, rows, columns], (2, 3), (0, 1))
        return cut.reshape(*cut.shape[:2], -1)

    def _bodies(self, sensor: Sensor) -> Arrays:
        """Return chips (body, value) of simulated bodies over this lane's background, and how far ahead each lies."""
        setup = self.setup
        known = self.setup.results["gain"]
        grid = self.setup.images
        table = self.settings
        bands = tuple(setup.imager.subbands.items())
        labels = tuple(str(setup.run["polarization"].values[p]) for p in setup.imaged)
        window = setup.imager.window
        window = (
            window
            if window is None or isinstance(window, str)
            else tuple(np.asarray(window, dtype=float).tolist())
        )
        pixels = tuple(zip(self._across * grid.dx, self._down * grid.dy, strict=True))
        limits = max(grid.x_min, setup.lane.x_min), min(grid.extent()[1], setup.lane.x_max)
        how = _Imaging(grid, bands, labels, window, setup.imager.tolerance, pixels, limits)
        made: Arrays = {}
        for chips_name, ahead, kinds in (
            ("bodies", "ahead", table.kinds),
            ("stones", "stones_ahead", ()),
        ):
            raw, place = signatures(table, sensor, how, kinds)
            column, row = (
                np.round((place - (grid.x_min, grid.y_min)) / (grid.dx, grid.dy)).astype(int).T
            )
            level = np.moveaxis(known["gain"][:, :, row, column], 2, 0) * known["gains"].mean(
                axis=0
            )
            made[chips_name] = (raw / level[..., None]).reshape(len(raw), -1).astype(np.complex64)
            made[ahead] = place[:, 1] - grid.y_min
        return made


def ratio(
    chips: ComplexArray, vectors: ComplexArray, share: FloatArray, ratios: Sequence[float]
) -> FloatArray:
    """Log-likelihood ratio (...) of whitened chips (..., value), averaged over the powers ``ratios``.

    ``vectors`` (vector, value) are conjugate and orthonormal, ``share`` are the parts of the mean
    signature's power in them.
    """
    power = np.maximum((np.abs(chips) ** 2).sum(axis=-1), np.finfo(np.float32).tiny)
    part = np.abs(chips @ vectors.T) ** 2 / power[..., None]
    gain = np.array(ratios)[:, None] * share
    rest = np.maximum(1 - part @ (gain / (1 + gain)).T, 1e-6)
    each = -chips.shape[-1] * np.log(rest) - np.log1p(gain).sum(axis=1)
    return np.asarray(logsumexp(each, axis=-1) - math.log(len(ratios)))


class _Imaging(NamedTuple):
    """How chips of simulated bodies are made: pixels of images, of a chip about its place, and limits across (m)."""

    grid: Grid
    subbands: tuple[tuple[str, tuple[float, float]], ...]
    polarizations: tuple[str, ...]
    window: str | tuple[float, ...] | None
    tolerance: float
    pixels: tuple[tuple[float, float], ...]
    limits: tuple[float, float]


def _sensor_of(setup: Setup, name: str) -> Sensor:
    """Load the sensor, without missing sweeps and errors of navigation; refuse one that is not the run's array."""
    sensor = load_sensor(name)
    for end, ours in zip(("tx", "rx"), sensor.pairs(), strict=True):
        theirs = setup.run[f"{end}_position"].values
        if theirs.shape != np.shape(ours) or not np.allclose(theirs, ours, atol=0.01):
            raise ValueError(
                f"map.sensor must describe the run's array, got {name!r} with other {end} antennas"
            )
    tones = sensor.tones.axis()
    if not np.array_equal(np.round(tones), np.round(setup.run["frequency"].values)):
        raise ValueError(
            f"map.sensor must have the run's tones, got {name!r} with {len(tones)} others"
        )
    none = dict.fromkeys(("missing", "position", "heading", "attitude"), 0.0)
    return sensor.model_copy(update={"errors": sensor.errors.model_copy(update=none)})


@lru_cache(maxsize=4)
def signatures(
    table: LikelihoodSettings, sensor: Sensor, how: _Imaging, kinds: tuple[str, ...]
) -> tuple[ComplexArray, FloatArray]:
    """Simulate bodies alone: chips (body, polarization, subband, pixel), and places (body, 2) in the scan frame, m.

    Without ``kinds`` they are stones that lie half in the ground.
    """
    found = []
    places = []
    edge = 1.5 * table.step
    _, _, near, far = how.grid.extent()
    for number, (permittivity, loss) in enumerate(table.soils):
        rng = np.random.default_rng([_SEED, number])
        sorts = (
            [(kind, depth) for kind in kinds for depth in table.depths] or [("", 0.0)]
        ) * table.copies
        ahead = rng.permutation(np.linspace(near + edge, far - edge, len(sorts)))
        across = rng.uniform(how.limits[0] + edge, how.limits[1] - edge, len(sorts))
        lean = rng.normal(0, _TILT, (len(sorts), 2))
        where = [
            (float(x), float(_APART * k + y))
            for k, (x, y) in enumerate(zip(across, ahead, strict=True))
        ]
        targets = [
            {
                "kind": kind,
                "depth": depth,
                "x": x,
                "y": y,
                "tilt": math.hypot(a, b),
                "azimuth": math.atan2(b, a),
            }
            for (kind, depth), (x, y), (a, b) in zip(sorts, where, lean, strict=True)
        ]
        things = [
            {"kind": "rock", "x": x, "y": y, "radius": float(radius)}
            for (x, y), radius in zip(where, np.linspace(*_STONES, len(sorts)), strict=True)
        ]
        ground = {
            "soil": {"model": "fixed", "permittivity": permittivity, "loss_tangent": loss},
            "length": _APART * len(sorts), "x_min": how.limits[0], "x_max": how.limits[1], "clutter": BARE,
            "track": {"positions": [_APART * k for k in range(len(sorts))]}, **ALONE,
        }  # fmt: skip
        simulator = Simulator(
            Scene.model_validate(ground | {"targets": targets if kinds else []}), sensor, number
        )
        run = simulator.run(bodies=True)
        if not kinds:  # a stone is what the scan with it has more than the one without
            stony = Simulator(Scene.model_validate(ground | {"objects": things}), sensor, number)
            run["signal"] = stony.run()["signal"] - simulator.run()["signal"]
        run = run.sel(polarization=list(how.polarizations))
        imager = ScanImager(run, how.grid, dict(how.subbands), how.window, how.tolerance)
        for k, spot in enumerate(where):
            place = lane_to_scan(np.array([*spot, 0.0]), simulator.pose[k])
            place[:2] += rng.uniform(-table.step / 4, table.step / 4, 2)  # no mine lies on a pixel
            points = place + np.column_stack([how.pixels, np.zeros(len(how.pixels))])
            found.append(imager.operator_on(k, points, imager.subbands).adjoint(imager.signal(k)))
            places.append(place[:2])
    return np.stack(found), np.array(places)


def contrasts(image: xr.DataArray, table: LikelihoodSettings) -> NDArray[np.float32]:
    """Contrast (polarization, subband, y, x) of every pixel of an image to the ring about it, dB."""
    power = np.abs(image.values) ** 2
    steps = [float(image[axis].values[1] - image[axis].values[0]) for axis in "yx"]

    def mean(half: float) -> tuple[Any, float]:
        size = tuple(2 * round((half - step / 2) / step) + 1 for step in steps)
        return uniform_filter(power, (1, 1, *size), mode="nearest"), float(np.prod(size))

    (inner, _), (guard, few), (outer, count) = (
        mean(half) for half in (table.inner, table.guard, table.outer)
    )
    ring = (count * outer - few * guard) / (count - few)
    tiny = np.finfo(np.float32).tiny
    return np.asarray(
        10 * np.log10(np.maximum(inner, tiny) / np.maximum(ring, tiny)), dtype=np.float32
    )


def _single(values: NDArray[Any]) -> ComplexArray:
    return np.asarray(values, dtype=np.complex64)


def _metres_of(images: Grid) -> int:
    """Count the metres ahead that scan images reach over, begun ones too."""
    return max(1, math.ceil(images.extent()[3] - images.y_min))


def _between(pixels: NDArray[np.int64], count: int) -> FloatArray:
    """Make the matrix (count, pixel) that interpolates linearly between pixels and holds the ends."""
    return np.stack(
        [np.interp(np.arange(count), pixels, row) for row in np.eye(len(pixels))], axis=1
    )
