"""Variants of `fused`, tried on training and validation lanes of proving ground 2 with one site left out.

``python evidence/fused_variants.py GROUND OUT [--tier T] [--only NAME ...] [--without-further]`` reads the training and
validation lanes of a folder of ``flgpr benchmark run``. It never reads a test lane. It makes one further lane each in
earth and gravel (180 m, 40 mines of the sorts of the training lanes, seeds of its own), simulates signatures, and cuts
the chips of all looks at a raster of 0.2 m out of the cleaned images of seven sub-bands. What takes long is written to
OUT once.

Everything that is learnt comes from the metal and plastic lanes of the three other sites of the tier. A variant is a
map on the raster: the mean over looks, weighted by the inverse square of their distance, smoothed by 0.15 m. Its local
maxima within 0.5 m are alarms. So the figures are near those of the recipe, not the same.

A row tells mines found at 0.005, 0.01, 0.02 and 0.05 false alarms per m², by kind; of all mines those that the variant
alone and the reference alone find at 0.02, with the p of McNemar's exact test; and the change against the reference of
the mean of log10 of the false alarms at which a mine is found, with its standard error.

Names of experiments: ``bands`` (sub-bands, classes of bodies), ``weights`` (of looks), ``covariance`` (the lane's own),
``looks`` (several looks jointly, with and without their phases), ``offsets`` (narrow subspaces for places beside the
raster), ``injected`` and ``chips`` (classifiers of places, and of chips, trained on simulated bodies put into measured
ground), ``ignorance`` (what it costs not to know which signature it is).
"""

from __future__ import annotations

import argparse
import math
import zlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from scipy.ndimage import gaussian_filter, maximum_filter, uniform_filter
from scipy.special import logsumexp
from scipy.stats import binomtest
from sklearn.ensemble import HistGradientBoostingClassifier
from sklearn.linear_model import LogisticRegression
from sklearn.neural_network import MLPClassifier
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

from flgpr.chain.lane_setup import LaneSetup
from flgpr.chain.method import engine_of
from flgpr.chain.recipe import parse_recipe, recipe_text
from flgpr.chain.stages.likelihood import LikelihoodSettings, contrasts
from flgpr.chain.stages.textured_clutter import ratio
from flgpr.imaging import ScanImager
from flgpr.model import Grid, lane_to_scan, load_sensor
from flgpr.proving_ground.ground import GroundLane, LaneRow, load_ground
from flgpr.proving_ground.oracle import STEP, chips_at, places_in_sight
from flgpr.simulate import ALONE, BARE, Scene, Simulator
from flgpr.store import open_run

BANDS = {
    "B0": (0.45e9, 0.60e9),
    "B1": (0.60e9, 0.80e9),
    "B2": (0.80e9, 1.05e9),
    "B3": (1.05e9, 1.40e9),
    "B4": (1.40e9, 1.85e9),
    "B5": (1.85e9, 2.35e9),
    "B6": (2.35e9, 2.95e9),
}
MIDDLES = np.array([(low + high) / 2 for low, high in BANDS.values()])
LIGHT = 299_792_458.0  # m/s
LOW = (0, 1, 2)  # sub-bands of `fused`
FOUR = (0, 1, 2, 3)
NEAREST = 7.0  # m, the first row of the images
METRES = 9  # looks lie between 7 and 16 m ahead
HEIGHT = 5.0  # m, of the array
RATES = (0.005, 0.01, 0.02, 0.05)  # per m²
RATE = 0.02
HALO = 1.0  # m
RATIOS = LikelihoodSettings(sensor="sri-array").ratios
FURTHER = LaneRow(
    part="validate",
    length=180.0,
    targets=(
        ("metal", 0.0, 3), ("metal", 0.05, 5), ("metal", 0.10, 5), ("metal", 0.15, 3),
        ("tm-62p", 0.05, 3), ("tm-62p", 0.10, 3), ("vs-1-6", 0.05, 3), ("vs-1-6", 0.10, 3),
        ("m19", 0.05, 3), ("m19", 0.10, 3), ("pmn", 0.01, 6),
    ),
)  # fmt: skip
FURTHER_SITES = ("earth", "gravel")  # in sand metal is found and plastic is not, in clay neither
SOILS = ((2.7, 0.01), (4.0, 0.02), (6.0, 0.05), (9.0, 0.1), (14.0, 0.15))
BODIES = {
    "metal": {"kind": "metal"},
    "tm-62p": {"kind": "plastic", "body": "tm-62p"},
    "vs-1.6": {"kind": "plastic", "body": "vs-1.6"},
    "m19": {"kind": "plastic", "body": "m19"},
    "plastic-at": {"kind": "plastic", "body": "plastic-at"},
    "plastic-at-cavity": {"kind": "plastic", "body": "plastic-at-cavity"},
    "pmn": {"kind": "ap", "body": "pmn"},
}
# VS-2.2 and PMA-1 lie in no training lane and are in no class.
CLASSES = {
    "metal": ("metal",),
    "fuzed": ("tm-62p",),
    "air": ("vs-1.6", "m19", "plastic-at", "plastic-at-cavity"),
    "ap": ("pmn",),
}
DEPTHS = {"metal": (-0.15, 0.0, 0.03, 0.06, 0.1, 0.15), "pmn": (0.005, 0.01, 0.02, 0.04)}
OTHER_DEPTHS = (0.0, 0.03, 0.06, 0.09, 0.12)
COPIES = 2
LOOKS = 7.4 + 0.95 * np.arange(10)  # m ahead of a simulated body
NAVIGATION = 0.022  # m along the line of sight: errors of place, and pixels of 0.05 m


# Lanes and looks


@dataclass
class Lane:
    """All looks at the places of a raster on a lane, and what lies in it."""

    site: str
    design: str
    columns: int  # of the raster
    rows: int
    x_min: float
    y_min: float
    place: np.ndarray  # (look,) number of the place
    scan: np.ndarray  # (look,)
    xy: np.ndarray  # (look, 2) in the scan frame, m
    chip: np.ndarray  # (look, polarization, sub-band, pixel)
    contrast: np.ndarray  # (look, polarization, sub-band) dB
    gain: np.ndarray  # (polarization, sub-band, y, x): level of the images' background
    targets: np.ndarray  # (target, 2) m
    kinds: np.ndarray
    groups: dict = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.metre = np.clip((self.xy[:, 1] - NEAREST).astype(int), 0, METRES - 1)
        self.weight = 1 / (self.xy.astype(float) ** 2).sum(axis=1)
        number = np.arange(self.columns * self.rows)
        x = self.x_min + STEP * (number % self.columns)
        y = self.y_min + STEP * (number // self.columns)
        self.points = np.column_stack([x, y])
        self.to_target = distances(self.points, self.targets)
        self.free = self.to_target[self.place] > 1.2

    @property
    def places(self) -> int:
        """Number of places of the raster."""
        return self.columns * self.rows

    def chips(self, bands: Sequence[int]) -> np.ndarray:
        """Return the chips (look, value) of some sub-bands."""
        return self.chip[:, :, list(bands)].reshape(len(self.chip), -1)

    def mean(self, values: np.ndarray, weights: np.ndarray | None = None) -> np.ndarray:
        """Return the weighted mean over looks (y, x) of a value of each."""
        weights = self.weight if weights is None else weights
        total = np.bincount(self.place, weights * values, self.places)
        weight = np.bincount(self.place, weights, self.places)
        seen = np.where(weight > 0, total / np.maximum(weight, 1e-30), np.nan)
        return seen.reshape(self.rows, self.columns)

    def area(self) -> float:
        """Return the area in which alarms are false, m²."""
        fine = 0.05
        x = np.arange(self.x_min, self.x_min + STEP * (self.columns - 1) + 1e-9, fine)
        y = np.arange(self.y_min, self.y_min + STEP * (self.rows - 1) + 1e-9, fine)
        points = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
        far = distances(points, self.targets) > HALO
        return float(far.mean()) * STEP**2 * self.columns * (self.rows - 1)


def distances(points: np.ndarray, targets: np.ndarray) -> np.ndarray:
    """Return the distance of every point to the nearest target, m."""
    nearest = np.full(len(points), np.inf)
    for target in targets:
        nearest = np.minimum(nearest, np.linalg.norm(points - target, axis=1))
    return nearest


def ground_lanes(
    folder: Path, out: Path, tier: str, further: bool
) -> Iterator[tuple[GroundLane, Path]]:
    """Yield the lanes of a tier that are not test lanes, with their run stores."""
    (ground,) = load_ground().chosen_tiers(tier)
    for lane in ground.lanes.values():
        if lane.part != "test":
            yield lane, folder / "lanes" / f"{lane.name}.zarr"
    if not further:
        return
    for site, packaged in ground.table.tiers[tier].sites.items():
        if site not in FURTHER_SITES:
            continue
        name = f"{tier}-{site}-further-1"
        scene = ground._scene(packaged, FURTHER, {}).model_copy(update={"name": name})
        seed = zlib.crc32(f"ablation of fused {name}".encode())
        sensor = load_sensor(ground.table.sensor)
        lane = GroundLane(name, site, "validate", scene.lane, seed, scene, sensor, tier=tier)
        store = out / "lanes" / f"{name}.zarr"
        if not store.exists():
            store.parent.mkdir(parents=True, exist_ok=True)
            lane.make(store)
        yield lane, store


def images_recipe():
    """Return a recipe that images and cleans as `fused` does, in all sub-bands, without its map."""
    text = recipe_text("fused")
    head, _, rest = text.partition("[map]")
    tail = rest[rest.index("[run_view]") :].replace(
        'polarization = "likelihood"', 'polarization = "HH"'
    )
    tail = tail.replace('subband = "all"', 'subband = "B1"')
    tail = tail[: tail.index("[detector]")] + tail[tail.index("[score]") :]
    more = "".join(f"{name} = [{low}, {high}]\n" for name, (low, high) in list(BANDS.items())[3:])
    return parse_recipe(head.replace("\n[background]", f"{more}\n[background]") + tail, "images")


def cut_looks(lane: GroundLane, store: Path, file: Path) -> None:
    """Write all looks at a lane into a file."""
    setup = LaneSetup(open_run(store), images_recipe(), lane.lane, explains=False)
    engine_of(setup).run(names=("signature", "gain"))
    cleaned = setup.cleaned
    borders = lane.lane
    raster = Grid.spanning((borders.x_min, borders.x_max), (borders.y_min, borders.y_max), STEP)
    points = raster.points().reshape(-1, 3)
    table = LikelihoodSettings(sensor="sri-array")
    parts: dict[str, list] = {name: [] for name in ("place", "scan", "xy", "chip", "contrast")}
    for index in range(len(cleaned)):
        image = cleaned.coherent(index)
        numbers, places = places_in_sight(setup, points, image.attrs["pose"])
        if not len(numbers):
            continue
        row = np.round((places[:, 1] - cleaned.grid.y_min) / cleaned.grid.dy).astype(int)
        column = np.round((places[:, 0] - cleaned.grid.x_min) / cleaned.grid.dx).astype(int)
        shown = np.moveaxis(contrasts(image, table)[:, :, row, column], 2, 0)
        parts["place"].append(numbers)
        parts["scan"].append(np.full(len(numbers), index))
        parts["xy"].append(places)
        parts["chip"].append(chips_at(image.values, cleaned.grid, places))
        parts["contrast"].append(shown)
    result = setup.results["gain"]
    truth = lane.truth()
    arrays = {name: np.concatenate(values) for name, values in parts.items()}
    arrays["chip"] = arrays["chip"].reshape(len(arrays["chip"]), 3, len(BANDS), 9)
    np.savez(
        file,
        **arrays,
        shape=(raster.nx, raster.ny),
        corner=(raster.x_min, raster.y_min),
        gain=result["gain"] * result["gains"].mean(axis=0)[..., None, None],
        targets=truth[["x", "y"]].to_numpy(),
        kinds=truth["kind"].to_numpy(dtype="U12"),
    )


def load_lanes(folder: Path, out: Path, tier: str, further: bool) -> list[Lane]:
    """Return the lanes of a tier; looks that are not in the folder are cut first."""
    lanes = []
    for lane, store in ground_lanes(folder, out, tier, further):
        file = out / "looks" / f"{lane.name}.npz"
        if not file.is_file():
            file.parent.mkdir(parents=True, exist_ok=True)
            cut_looks(lane, store, file)
        with np.load(file) as data:
            arrays = dict(data)
        columns, rows = (int(number) for number in arrays.pop("shape"))
        x_min, y_min = (float(number) for number in arrays.pop("corner"))
        design = lane.name.split("-")[-2]
        lanes.append(Lane(lane.site, design, columns, rows, x_min, y_min, **arrays))
    return lanes


# Signatures


@dataclass
class Signatures:
    """Bodies alone in the ground, each seen in ten looks at one place, the phases right."""

    chip: np.ndarray  # (body, look, polarization, sub-band, pixel)
    place: np.ndarray  # (body, look, 2) of the chip's middle in the scan frame, m
    depth: np.ndarray  # (body,)
    soil: np.ndarray  # (body,) number
    beside: np.ndarray  # (body, 2) of the chip's middle from the body, m

    def in_units(self, lane: Lane) -> np.ndarray:
        """Return the chips in units of a lane's background."""
        column = np.round((self.place[..., 0] + 6.0) / 0.05).astype(int)
        row = np.round((self.place[..., 1] - NEAREST) / 0.05).astype(int)
        row = np.clip(row, 0, lane.gain.shape[2] - 1)
        return self.chip / np.moveaxis(lane.gain[:, :, row, column], (0, 1), (2, 3))[..., None]

    def by_metre(self, chips: np.ndarray) -> np.ndarray:
        """Return of chips (body, look, ...) those nearest to the middle of each metre ahead."""
        middles = np.arange(METRES) + NEAREST + 0.5
        nearest = np.abs(self.place[:, None, :, 1] - middles[:, None]).argmin(axis=-1)
        return chips[np.arange(len(chips))[:, None], nearest]

    def moved(self, chips: np.ndarray, ahead: float, bands: Sequence[int]) -> np.ndarray:
        """Return chips (body, look, polarization, sub-band, pixel) as at a place ahead of the body.

        A sub-band's range cell is several times longer than the move: only its phase changes.
        """
        x, y = self.place[..., 0], self.place[..., 1]
        sine = y / np.sqrt(x**2 + y**2 + HEIGHT**2)
        move = (ahead - self.beside[:, None, 1]) * sine
        return chips * phases_of(move, bands)


def phases_of(metres: np.ndarray, bands: Sequence[int]) -> np.ndarray:
    """Return the factors (..., 1, sub-band, 1) of a move along the line of sight, m."""
    angle = 4 * np.pi * MIDDLES[list(bands)] / LIGHT * metres[..., None]
    return np.exp(1j * angle)[..., None, :, None]


def simulate_signatures(name: str, out: Path) -> Signatures:
    """Return the signatures of a body in all soils, from the folder if they are there."""
    file = out / "signatures" / f"{name}.npz"
    if not file.is_file():
        file.parent.mkdir(parents=True, exist_ok=True)
        parts = [_in_soil(name, number) for number in range(len(SOILS))]
        joined = [np.concatenate(values) for values in zip(*parts, strict=True)]
        np.savez(
            file, **dict(zip(("chip", "place", "depth", "soil", "beside"), joined, strict=True))
        )
    with np.load(file) as data:
        return Signatures(**data)


def _in_soil(name: str, soil: int) -> tuple[np.ndarray, ...]:
    """Simulate a body in one soil at all depths, every copy alone."""
    rng = np.random.default_rng([31, soil, len(name)])
    depths = np.repeat(DEPTHS.get(name, OTHER_DEPTHS), COPIES)
    count = len(depths)
    apart = 100.0
    x = rng.uniform(-1.4, 1.4, count)
    y = apart * np.arange(count) + 30.0
    lean = rng.normal(0, math.radians(4), (count, 2))
    beside = rng.uniform(-STEP / 2, STEP / 2, (count, 2))
    scans = (y[:, None] - LOOKS - rng.uniform(-0.3, 0.3, (count, len(LOOKS)))).ravel()
    heading = rng.uniform(0, 2 * math.pi, count)
    order = np.argsort(scans)
    targets = []
    for number in range(count):
        target = BODIES[name] | {"x": x[number], "y": y[number], "depth": depths[number]}
        target["tilt"] = math.hypot(*lean[number])
        target["azimuth"] = math.atan2(lean[number, 1], lean[number, 0])
        if name == "m19":
            target["heading"] = heading[number]
        targets.append(target)
    permittivity, loss = SOILS[soil]
    scene = {
        "soil": {"model": "fixed", "permittivity": permittivity, "loss_tangent": loss},
        "length": apart * count, "x_min": -1.5, "x_max": 1.5, "clutter": BARE,
        "track": {"positions": scans[order].tolist()}, "targets": targets, **ALONE,
    }  # fmt: skip
    sensor = load_sensor("sri-array")
    exact = dict.fromkeys(("missing", "position", "heading", "attitude"), 0.0)
    sensor = sensor.model_copy(update={"errors": sensor.errors.model_copy(update=exact)})
    simulator = Simulator(Scene.model_validate(scene), sensor, soil)
    imager = ScanImager(
        simulator.run(bodies=True), Grid.spanning((-6, 6), (7, 26), 0.05), BANDS, "hann", 1e-3
    )
    about = STEP * np.mgrid[-1:2, -1:2].reshape(2, -1)
    pixels = np.column_stack([about[1], about[0], np.zeros(9)])
    chips = np.zeros((len(scans), 3, len(BANDS), 9), np.complex64)
    places = np.zeros((len(scans), 2))
    for scan, number in enumerate(order):
        body = number // len(LOOKS)
        middle = np.array([x[body] + beside[body, 0], y[body] + beside[body, 1], 0.0])
        place = lane_to_scan(middle, simulator.pose[scan])
        operator = imager.operator_on(scan, place + pixels, imager.subbands)
        chips[number] = operator.adjoint(imager.signal(scan))
        places[number] = place[:2]
    shape = (count, len(LOOKS))
    return (
        chips.reshape(*shape, 3, len(BANDS), 9), places.reshape(*shape, 2), depths,
        np.full(count, soil), beside,
    )  # fmt: skip


# What is learnt


@dataclass
class Clutter:
    """What whitens chips of some sub-bands by metre ahead."""

    bands: tuple[int, ...]
    covariance: np.ndarray  # (metre, value, value), of unit power
    whitener: np.ndarray  # (metre, value, value)

    @classmethod
    def of(cls, bands: Sequence[int], covariance: np.ndarray) -> Clutter:
        """Return the clutter of a covariance (metre, value, value)."""
        size = covariance.shape[-1]
        power = np.trace(covariance, axis1=1, axis2=2).real
        even = covariance * (size / power)[:, None, None]
        whitener = np.linalg.inv(np.linalg.cholesky(even + 1e-3 * np.eye(size)))
        return cls(tuple(bands), even, whitener.astype(np.complex64))

    @property
    def values(self) -> int:
        """Number of values of a chip."""
        return self.covariance.shape[-1]

    def white(self, lane: Lane) -> np.ndarray:
        """Return the whitened chips (look, value) of a lane."""
        return self.whitened(lane.chips(self.bands), lane.metre)

    def whitened(self, chips: np.ndarray, metre: np.ndarray) -> np.ndarray:
        """Return whitened chips (look, value)."""
        white = np.empty_like(chips)
        for number in np.unique(metre):
            at = metre == number
            white[at] = chips[at] @ self.whitener[number].T
        return white


def sums_of(chips: np.ndarray, metre: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return sums of x x^H by metre, every chip over its own power, and their numbers."""
    size = chips.shape[1]
    total = np.zeros((METRES, size, size), complex)
    count = np.zeros(METRES)
    for number in np.unique(metre):
        some = chips[metre == number]
        power = (np.abs(some) ** 2).mean(axis=1, keepdims=True)
        some = some / np.sqrt(np.maximum(power, 0.05))
        total[number] = some.T @ some.conj()
        count[number] = len(some)
    return total, count


def with_neighbours(total: np.ndarray, count: np.ndarray) -> np.ndarray:
    """Return the covariance of every metre and of those before and after it."""
    covariance = []
    for metre in range(METRES):
        near = slice(max(metre - 1, 0), metre + 2)
        covariance.append(total[near].sum(axis=0) / max(count[near].sum(), 1))
    return np.array(covariance)


@dataclass
class Trained:
    """What the lanes of the other sites teach, for the lanes of one site."""

    lanes: list[Lane]
    signatures: dict[str, Signatures]
    known: dict[tuple[int, ...], tuple[Clutter, dict[str, list]]] = field(default_factory=dict)

    def classes(self, bands: Sequence[int]) -> tuple[Clutter, dict[str, list]]:
        """Return the clutter, and the directions of every class of bodies in it."""
        key = tuple(bands)
        if key not in self.known:
            clutter = self.clutter(bands)
            found = {}
            for name, bodies in CLASSES.items():
                found[name] = self.directions(clutter, bodies, rank_of(bands))
            self.known[key] = (clutter, found)
        return self.known[key]

    def clutter(self, bands: Sequence[int]) -> Clutter:
        """Return the clutter of target-free ground."""
        total, count = 0.0, 0.0
        for lane in self.lanes:
            of_lane = sums_of(lane.chips(bands)[lane.free], lane.metre[lane.free])
            total, count = total + of_lane[0], count + of_lane[1]
        return Clutter.of(bands, with_neighbours(total, count))

    def directions(
        self, clutter: Clutter, bodies: Sequence[str], rank: int, ahead: float | None = None
    ) -> list[tuple[np.ndarray, np.ndarray]]:
        """Return the principal vectors of bodies in whitened clutter, and their shares, by metre.

        With ``ahead`` all chips are moved to a place so far ahead of the body.
        """
        chips, places = [], []
        bands = clutter.bands
        for body in bodies:
            of_body = self.signatures[body]
            for lane in self.lanes[::2]:
                some = of_body.in_units(lane)[:, :, :, list(bands)]
                if ahead is not None:
                    some = of_body.moved(some, ahead, bands)
                chips.append(some.reshape(-1, clutter.values))
                places.append(of_body.place[..., 1].ravel() - NEAREST)
        chip, place = np.concatenate(chips), np.concatenate(places)
        found = []
        for metre in range(METRES):
            near = np.abs(place - metre - 0.5) < 1.0
            white = chip[near] @ clutter.whitener[metre].T
            white = white / np.linalg.norm(white, axis=1, keepdims=True)
            _, strength, vectors = np.linalg.svd(white, full_matrices=False)
            share = strength**2 / (strength**2).sum()
            found.append((vectors.conj()[:rank].astype(np.complex64), share[:rank]))
        return found


def ratios_of(white: np.ndarray, metre: np.ndarray, directions: list) -> np.ndarray:
    """Return the log-likelihood ratio of every whitened look."""
    value = np.empty(len(white))
    for number in np.unique(metre):
        at = metre == number
        value[at] = ratio(white[at], *directions[number], RATIOS)
    return value


# Alarms and scores


def smoothed(values: np.ndarray) -> np.ndarray:
    """Smooth a map as `fused` does; places that were never seen have the least value."""
    filled = np.where(np.isfinite(values), values, np.nanmin(values))
    return gaussian_filter(filled, 0.15 / STEP, mode="nearest")


def alarms_of(lane: Lane, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return places (alarm, 2) and values of the local maxima within 0.5 m."""
    v, u = np.mgrid[-2:3, -2:3]
    disc = (u**2 + v**2) * STEP**2 <= 0.5**2
    row, column = np.nonzero(values == maximum_filter(values, footprint=disc, mode="nearest"))
    places = np.column_stack([lane.x_min + STEP * column, lane.y_min + STEP * row])
    return places, values[row, column]


@dataclass
class Found:
    """False alarms per m² at which every target is found."""

    far: np.ndarray
    kinds: np.ndarray
    sites: np.ndarray

    @classmethod
    def on(cls, lanes: Sequence[Lane], maps: Sequence[np.ndarray]) -> Found:
        """Score maps of lanes as one list."""
        false, best, kinds, sites, area = [], [], [], [], 0.0
        for lane, values in zip(lanes, maps, strict=True):
            places, height = alarms_of(lane, values)
            false.append(height[distances(places, lane.targets) > HALO])
            for target, kind in zip(lane.targets, lane.kinds, strict=True):
                near = np.linalg.norm(places - target, axis=1) <= HALO
                best.append(height[near].max() if near.any() else -np.inf)
                kinds.append(kind)
                sites.append(lane.site)
            area += lane.area()
        ordered = np.sort(np.concatenate(false))
        values = np.array(best)
        far = (len(ordered) - np.searchsorted(ordered, values)) / area
        far[~np.isfinite(values)] = np.inf
        return cls(far, np.array(kinds), np.array(sites))

    def log_far(self) -> np.ndarray:
        """Return log10 of the false alarms, between one on the lanes and more than counts."""
        return np.log10(np.clip(self.far, 3e-4, 0.3))

    def row(self, name: str, reference: Found) -> str:
        """Return a row of the table."""
        cells = [name]
        for kind in ("metal", "plastic", "ap"):
            found = [int((self.far[self.kinds == kind] < rate).sum()) for rate in RATES]
            cells.append(", ".join(str(number) for number in found))
        mine = self.kinds != "simulant"
        cells.append(", ".join(str(int((self.far[mine] < rate).sum())) for rate in RATES))
        ours, theirs = self.far[mine] < RATE, reference.far[mine] < RATE
        alone, others = int((ours & ~theirs).sum()), int((theirs & ~ours).sum())
        p = binomtest(alone, alone + others).pvalue if alone + others else 1.0
        cells.append(f"{alone}, {others} ({p:.2g})")
        for kind in ("metal", "plastic"):
            change = (self.log_far() - reference.log_far())[self.kinds == kind]
            error = change.std(ddof=1) / math.sqrt(len(change))
            cells.append(f"{change.mean():+.3f} ± {error:.3f}")
        return f"| {' | '.join(cells)} |"


class Bench:
    """The lanes of one tier, every site with what the other sites teach."""

    def __init__(self, tier: str, lanes: list[Lane], signatures: dict[str, Signatures]) -> None:
        self.tier = tier
        self.lanes = lanes
        self.signatures = signatures
        self.trained = {}
        for lane in lanes:
            others = [
                other for other in lanes
                if other.site != lane.site and other.design in ("metal", "plastic")
            ]  # fmt: skip
            self.trained.setdefault(lane.site, Trained(others, signatures))
        self.reference: Found | None = None

    def by_site(self, learn: Callable[[Trained], object]) -> dict[str, object]:
        """Return what is learnt for every site."""
        return {site: learn(trained) for site, trained in self.trained.items()}

    def tell(self, name: str, value: Callable[[Lane], np.ndarray]) -> None:
        """Print the row of a variant; ``value`` is a map (y, x). The first is the reference."""
        found = Found.on(self.lanes, [smoothed(value(lane)) for lane in self.lanes])
        if self.reference is None:
            self.reference = found
            mines = {kind: int((found.kinds == kind).sum()) for kind in ("metal", "plastic", "ap")}
            print(f"\n{self.tier}: {mines}\n")
            print("| map | metal | plastic | AP | all | alone (p) | metal | plastic |")
            print("|---|---|---|---|---|---|---|---|")
        print(found.row(name, self.reference), flush=True)


def level(lane: Lane, bands: Sequence[int] = LOW) -> np.ndarray:
    """Return the mean contrast (look,) in HH and VV of some sub-bands, dB."""
    return lane.contrast[:, :2, list(bands)].mean(axis=(1, 2))


# Experiments


def names_of(bands: Sequence[int]) -> str:
    """Return the limits of a range of sub-bands in words."""
    limits = list(BANDS.values())
    return f"{limits[bands[0]][0] / 1e9:g} to {limits[bands[-1]][1] / 1e9:g} GHz"


def rank_of(bands: Sequence[int]) -> int:
    """Return the number of directions for some sub-bands: 12 for three, four more for each."""
    return 12 + 4 * (len(bands) - 3)


def try_bands(bench: Bench) -> None:
    """Try ranges of sub-bands, and signatures of other bodies as classes of their own."""
    bench.tell("contrast of HH and VV alone", lambda lane: lane.mean(level(lane)))
    for bands in (FOUR, (0, 1, 2, 3, 4), tuple(range(7)), LOW):
        values: dict[int, dict[str, np.ndarray]] = {}
        learnt = bench.by_site(lambda trained, bands=bands: trained.classes(bands))
        for lane in bench.lanes:
            clutter, directions = learnt[lane.site]
            white = clutter.white(lane)
            values[id(lane)] = {
                name: ratios_of(white, lane.metre, found) for name, found in directions.items()
            }

        def pooled(lane: Lane, names: Sequence[str], values=values) -> np.ndarray:
            some = [values[id(lane)][name] for name in names]
            return logsumexp(some, axis=0) - math.log(len(some))

        title = names_of(bands)
        if bands != LOW:
            bench.tell(
                title, lambda lane, v=pooled: lane.mean(v(lane, ["metal"]) + 2 * level(lane))
            )
        else:
            bench.tell(
                f"{title}, without contrast", lambda lane, v=pooled: lane.mean(v(lane, ["metal"]))
            )
            for names in (["fuzed"], ["air"], ["ap"], list(CLASSES)):
                bench.tell(
                    f"{title}, signatures of {' or '.join(names)}",
                    lambda lane, v=pooled, n=names: lane.mean(v(lane, n) + 2 * level(lane)),
                )
        if bands == FOUR:
            bench.tell(
                f"{title}, contrast of all four",
                lambda lane, v=pooled: lane.mean(v(lane, ["metal"]) + 2 * level(lane, FOUR)),
            )


def try_weights(bench: Bench) -> None:
    """Weight looks otherwise by their distance, or leave the far ones out."""
    learnt = bench.by_site(lambda trained: trained.classes(LOW))
    values = {}
    for lane in bench.lanes:
        clutter, directions = learnt[lane.site]
        found = ratios_of(clutter.white(lane), lane.metre, directions["metal"])
        values[id(lane)] = found + 2 * level(lane)
    for title, power, farthest in (
        ("looks weighted by the inverse of their distance", 1, 16.0),
        ("looks weighted by its inverse cube", 3, 16.0),
        ("looks up to 12 m ahead", 2, 12.0),
    ):

        def value(lane: Lane, power=power, farthest=farthest) -> np.ndarray:
            distance = np.linalg.norm(lane.xy.astype(float), axis=1)
            weight = distance**-power * (lane.xy[:, 1] <= farthest)
            return lane.mean(values[id(lane)], weight)

        bench.tell(title, value)


def try_covariance(bench: Bench) -> None:
    """Mix the covariance of the lane itself into that of the training lanes."""
    for bands in (LOW, FOUR):
        learnt = bench.by_site(lambda trained, bands=bands: trained.classes(bands))
        for share in (0.3, 0.6, 0.9):

            def value(lane: Lane, bands=bands, learnt=learnt, share=share) -> np.ndarray:
                prior, directions = learnt[lane.site]
                first = ratios_of(prior.white(lane), lane.metre, directions["metal"])
                # A tenth of the places, those most like a mine, is left out.
                seen = lane.mean(first + 2 * level(lane)).ravel()
                ordinary = (seen <= np.nanquantile(seen, 0.9))[lane.place]
                own = with_neighbours(*sums_of(lane.chips(bands)[ordinary], lane.metre[ordinary]))
                own *= prior.values / np.trace(own, axis1=1, axis2=2).real[:, None, None]
                mixed = Clutter.of(bands, (1 - share) * prior.covariance + share * own)
                moved = carried(directions["metal"], prior, mixed)
                return lane.mean(ratios_of(mixed.white(lane), lane.metre, moved) + 2 * level(lane))

            bench.tell(f"{names_of(bands)}, {share:g} of the lane's own covariance", value)


def carried(directions: list, prior: Clutter, clutter: Clutter) -> list:
    """Return directions in other clutter: those of the same mean signature."""
    found = []
    for metre, (vectors, share) in enumerate(directions):
        back = np.linalg.inv(prior.whitener[metre].astype(complex))
        strong = clutter.whitener[metre] @ (back @ (vectors.conj().T * np.sqrt(share)))
        left, strength, _ = np.linalg.svd(strong, full_matrices=False)
        new_share = strength**2 * (share.sum() / (strength**2).sum())
        found.append((left.T.conj().astype(np.complex64), new_share))
    return found


def try_looks(bench: Bench) -> None:
    """Take the looks at a place as one vector, with the phases between them and without.

    Every look is over its own power. S is that of all signatures over all looks; the errors of
    navigation move every look by itself.
    """
    everything = [body for bodies in CLASSES.values() for body in bodies]
    for bodies, title in ((CLASSES["metal"], "metal"), (everything, "all bodies")):
        for coherent in (False, True):
            learnt = bench.by_site(lambda trained, b=bodies, c=coherent: _stacked(trained, b, c))
            words = "with phases" if coherent else "without phases"
            bench.tell(
                f"looks jointly, {words}, signatures of {title}",
                lambda lane, known=learnt, c=coherent: (
                    _joint(lane, *known[lane.site], c) + 2 * lane.mean(level(lane))
                ),
            )


def _stacked(
    trained: Trained, bodies: Sequence[str], coherent: bool
) -> tuple[Clutter, np.ndarray, np.ndarray]:
    """Return the clutter, 24 directions by metre, and bodies (body, metre, direction) in them."""
    clutter = trained.clutter(LOW)
    rng = np.random.default_rng(51)
    chips = []
    for body in bodies:
        of_body = trained.signatures[body]
        for lane in trained.lanes[::2]:
            some = of_body.by_metre(of_body.in_units(lane))[:, :, :, list(LOW)]
            for _ in range(3 if coherent else 1):
                error = rng.normal(0, NAVIGATION, some.shape[:2])
                chips.append((some * phases_of(error, LOW)).reshape(len(some), METRES, -1))
    chip = np.concatenate(chips).astype(np.complex64)
    white = np.stack([chip[:, m] @ clutter.whitener[m].T for m in range(METRES)], axis=1)
    white /= np.sqrt((np.abs(white) ** 2).sum(axis=2).mean(axis=1))[:, None, None]
    vectors = []
    for metre in range(METRES):
        of_metre = white[:, metre]
        _, _, right = np.linalg.svd(
            of_metre / np.linalg.norm(of_metre, axis=1)[:, None], full_matrices=False
        )
        vectors.append(right[:24].conj())
    parts = np.stack([white[:, m] @ vectors[m].T for m in range(METRES)], axis=1)
    return clutter, np.array(vectors), parts


def _joint(lane: Lane, clutter: Clutter, vectors, parts, coherent: bool) -> np.ndarray:
    """Return the log-likelihood ratio (y, x) of all looks at each place over their number."""
    white = clutter.white(lane)
    power = (np.abs(white) ** 2).sum(axis=1)
    part = np.empty((len(white), vectors.shape[1]), np.complex64)
    for metre in range(METRES):
        at = lane.metre == metre
        part[at] = white[at] @ vectors[metre].T
    part = part / np.sqrt(power / clutter.values)[:, None]
    value = np.full(lane.places, np.nan)
    for metres, (places, looks) in _alike(lane).items():
        count, rank = len(metres), vectors.shape[1]
        stacked = parts[:, list(metres)]
        body = np.zeros((count * rank, count * rank), complex)
        if coherent:
            joined = stacked.reshape(len(stacked), -1)
            body = joined.T @ joined.conj() / len(joined)
        else:
            for look in range(count):
                block = slice(look * rank, (look + 1) * rank)
                one = stacked[:, look]
                body[block, block] = one.T @ one.conj() / len(one)
        strength, directions = np.linalg.eigh(body)
        strength = np.maximum(strength[::-1][:60], 0)
        directions = directions[:, ::-1][:, :60].astype(np.complex64)
        shown = part[looks].reshape(len(places), -1) @ directions.conj()
        share = np.abs(shown) ** 2 / (count * clutter.values)
        gain = np.array(RATIOS)[:, None] * strength
        rest = np.maximum(1 - share @ (gain / (1 + gain)).T, 1e-6)
        by_power = -clutter.values * count * np.log(rest) - np.log1p(gain).sum(axis=1)
        value[places] = (logsumexp(by_power, axis=1) - math.log(len(RATIOS))) / count
    return value.reshape(lane.rows, lane.columns)


def _alike(lane: Lane) -> dict[tuple[int, ...], tuple[np.ndarray, np.ndarray]]:
    """Return places and their looks (place, look) by the metres at which the looks are."""
    if not lane.groups:
        order = np.lexsort((lane.scan, lane.place))
        first = np.flatnonzero(np.diff(lane.place[order], prepend=-1))
        found: dict[tuple[int, ...], list] = {}
        for looks in np.split(order, first[1:]):
            key = tuple(lane.metre[looks].tolist())
            found.setdefault(key, []).append((lane.place[looks[0]], looks))
        for key, pairs in found.items():
            places, looks = zip(*pairs, strict=True)
            lane.groups[key] = (np.array(places), np.array(looks))
    return lane.groups


def try_offsets(bench: Bench) -> None:
    """Take narrow subspaces for places beside the raster, the same for all looks at a place."""
    moves = (-0.08, -0.04, 0.0, 0.04, 0.08)
    for rank in (6, 12):

        def learn(trained: Trained, rank=rank) -> tuple[Clutter, list[list]]:
            clutter = trained.clutter(LOW)
            metal = CLASSES["metal"]
            return clutter, [trained.directions(clutter, metal, rank, ahead) for ahead in moves]

        learnt = bench.by_site(learn)

        def value(lane: Lane, learnt=learnt) -> np.ndarray:
            clutter, by_move = learnt[lane.site]
            white = clutter.white(lane)
            maps = [lane.mean(ratios_of(white, lane.metre, found)) for found in by_move]
            looks = np.bincount(lane.place, minlength=lane.places)
            looks = np.maximum(looks.reshape(lane.rows, lane.columns), 1)
            together = logsumexp(np.array(maps) * looks, axis=0) / looks
            return together + 2 * lane.mean(level(lane))

        bench.tell(f"metal at one of five offsets ahead, {rank} directions each", value)


# Simulated bodies in measured ground

SHARES = {
    "metal": 0.45, "tm-62p": 0.12, "vs-1.6": 0.11, "m19": 0.1, "plastic-at": 0.06,
    "plastic-at-cavity": 0.06, "pmn": 0.1,
}  # fmt: skip


@dataclass
class Looks:
    """Looks at some places, with bodies put in or as they are."""

    place: np.ndarray
    metre: np.ndarray
    weight: np.ndarray
    chip: np.ndarray
    ring: np.ndarray  # (look, polarization, sub-band) power about the place
    count: int  # of places

    def mean(self, values: np.ndarray) -> np.ndarray:
        """Return the weighted mean over looks (place,)."""
        total = np.bincount(self.place, self.weight * values, self.count)
        weight = np.bincount(self.place, self.weight, self.count)
        return np.where(weight > 0, total / np.maximum(weight, 1e-30), np.nan)


def ring_powers(lane: Lane) -> np.ndarray:
    """Return the mean power (look, polarization, sub-band) of chips 0.7 to 1.5 m about each."""
    power = (np.abs(lane.chip) ** 2).mean(axis=-1).reshape(len(lane.chip), -1)
    ring = np.empty_like(power)
    for scan in np.unique(lane.scan):
        at = np.flatnonzero(lane.scan == scan)
        row, column = np.divmod(lane.place[at], lane.columns)
        row = row - row.min()
        shape = (row.max() + 1, lane.columns)
        image = np.zeros((*shape, power.shape[1]))
        seen = np.zeros((*shape, 1))
        image[row, column] = power[at]
        seen[row, column] = 1

        def total(values: np.ndarray, half: int) -> np.ndarray:
            size = 2 * half + 1
            return uniform_filter(values, (size, size, 1), mode="constant") * size**2

        about = (total(image, 7) - total(image, 3)) / np.maximum(total(seen, 7) - total(seen, 3), 1)
        ring[at] = about[row, column]
    return ring.reshape(len(ring), 3, len(BANDS))


def free_places(lane: Lane) -> np.ndarray:
    """Return the numbers of places away from all targets that were seen."""
    return np.intersect1d(np.flatnonzero(lane.to_target > 1.5), lane.place)


def looks_at_some(lane: Lane, ring: np.ndarray, chosen: np.ndarray) -> Looks:
    """Return the looks at chosen places, in their order; a place may come twice."""
    order = np.argsort(lane.place, kind="stable")
    ordered = lane.place[order]
    looks, numbers = [], []
    for number, place in enumerate(chosen):
        low, high = np.searchsorted(ordered, [place, place + 1])
        looks.append(order[low:high])
        numbers.append(np.full(high - low, number))
    look = np.concatenate(looks)
    return Looks(
        np.concatenate(numbers), lane.metre[look], lane.weight[look], lane.chip[look].copy(),
        ring[look], len(chosen),
    )  # fmt: skip


def put_in_bodies(some: Looks, lane: Lane, bench: Bench, rng: np.random.Generator) -> None:
    """Put a drawn body into the chips of every place, at the level that it has on this lane."""
    units = {}
    for name, of_body in bench.signatures.items():
        units[name] = of_body.by_metre(of_body.in_units(lane))
    drawn = rng.choice(list(SHARES), some.count, p=list(SHARES.values()))
    first = np.searchsorted(some.place, np.arange(some.count + 1))
    for number, name in enumerate(drawn):
        looks = slice(first[number], first[number + 1])
        body = units[name][rng.integers(len(units[name]))]
        error = rng.normal(0, NAVIGATION, looks.stop - looks.start)
        some.chip[looks] += body[some.metre[looks]] * phases_of(error, range(len(BANDS)))


def features_of(some: Looks, known: Sequence[tuple[Clutter, dict[str, list]]]) -> np.ndarray:
    """Return the features (place, feature): mean ratios of all classes, and contrasts, dB."""
    columns = []
    for clutter, directions in known:
        chips = some.chip[:, :, list(clutter.bands)].reshape(len(some.chip), -1)
        white = clutter.whitened(chips, some.metre)
        for found in directions.values():
            columns.append(some.mean(ratios_of(white, some.metre, found)))
    power = (np.abs(some.chip) ** 2).mean(axis=-1)
    decibels = 10 * np.log10(np.maximum(power, 1e-6) / np.maximum(some.ring, 1e-6))
    for polarization in range(3):
        for band in range(len(BANDS)):
            columns.append(some.mean(decibels[:, polarization, band]))
    return np.stack(columns, axis=1)


def try_injected(bench: Bench) -> None:
    """Train classifiers on bodies put into the ground of the other sites."""
    rings = {id(lane): ring_powers(lane) for lane in bench.lanes}

    def learn(trained: Trained):
        rng = np.random.default_rng(51)
        known = [trained.classes(bands) for bands in (LOW, FOUR)]
        features, labels = [], []
        for lane in trained.lanes:
            free = free_places(lane)
            mines = looks_at_some(lane, rings[id(lane)], rng.choice(free, 250))
            put_in_bodies(mines, lane, bench, rng)
            ground = looks_at_some(lane, rings[id(lane)], rng.choice(free, 1500, replace=False))
            for some, label in ((mines, 1), (ground, 0)):
                features.append(features_of(some, known))
                labels.append(np.full(some.count, label))
        return known, np.concatenate(features), np.concatenate(labels)

    learnt = bench.by_site(learn)
    shown = {}
    for lane in bench.lanes:
        everything = Looks(
            lane.place, lane.metre, lane.weight, lane.chip, rings[id(lane)], lane.places
        )
        shown[id(lane)] = features_of(everything, learnt[lane.site][0])
    low = [*range(4), *(8 + 7 * polarization + band for polarization in range(3) for band in LOW)]
    every = list(range(shown[id(bench.lanes[0])].shape[1]))
    for title, columns in (("three sub-bands", low), ("four and all contrasts", every)):
        for name, make in (
            ("logistic regression", _logistic), ("trees, boosted", _boosted), ("network", _network),
        ):  # fmt: skip
            fitted = {}
            for site, (_, features, labels) in learnt.items():
                fitted[site] = make().fit(features[:, columns], labels)

            def value(lane: Lane, columns=columns, fitted=fitted) -> np.ndarray:
                features = shown[id(lane)][:, columns]
                seen = np.isfinite(features).all(axis=1)
                odds = np.full(lane.places, np.nan)
                p = fitted[lane.site].predict_proba(features[seen])[:, 1]
                p = np.clip(p, 1e-12, 1 - 1e-12)
                odds[seen] = np.log(p) - np.log1p(-p)
                return odds.reshape(lane.rows, lane.columns)

            bench.tell(f"injected bodies, {title}, {name}", value)


def _logistic():
    model = LogisticRegression(C=0.1, max_iter=300, class_weight="balanced")
    return make_pipeline(StandardScaler(), model)


def _boosted():
    return HistGradientBoostingClassifier(
        max_iter=150, learning_rate=0.06, max_leaf_nodes=15, l2_regularization=5.0,
        min_samples_leaf=40, random_state=0,
    )  # fmt: skip


def _network():
    model = MLPClassifier((32,), alpha=1.0, max_iter=100, early_stopping=True, random_state=0)
    return make_pipeline(StandardScaler(), model)


def try_chips(bench: Bench) -> None:
    """Train a network on the whitened chips of single looks; the map is its mean log odds.

    It sees a chip over its own power in 24 directions of all bodies, turned so that the first is
    real, how much power lies outside of them, and the contrast in HH and VV.
    """
    everything = [body for bodies in CLASSES.values() for body in bodies]
    rings = {id(lane): ring_powers(lane) for lane in bench.lanes}

    def inputs(some: Looks, clutter: Clutter, directions: list) -> np.ndarray:
        chips = some.chip[:, :, list(LOW)]
        white = clutter.whitened(chips.reshape(len(chips), -1), some.metre)
        white = white / np.linalg.norm(white, axis=1)[:, None]
        part = np.empty((len(white), 24), np.complex64)
        for metre in np.unique(some.metre):
            at = some.metre == metre
            part[at] = white[at] @ directions[metre][0].T
        part = part * np.exp(-1j * np.angle(part[:, :1]))
        rest = np.log(np.maximum(1 - (np.abs(part) ** 2).sum(axis=1), 1e-3))
        power = (np.abs(chips[:, :2]) ** 2).mean(axis=-1)
        around = some.ring[:, :2, list(LOW)]
        decibels = 10 * np.log10(np.maximum(power, 1e-6) / np.maximum(around, 1e-6))
        return np.column_stack([part.real, part.imag, rest, decibels.reshape(len(chips), -1)])

    def learn(trained: Trained):
        rng = np.random.default_rng(51)
        clutter = trained.clutter(LOW)
        directions = trained.directions(clutter, everything, 24)
        shown, labels = [], []
        for lane in trained.lanes:
            free = free_places(lane)
            mines = looks_at_some(lane, rings[id(lane)], rng.choice(free, 1000))
            put_in_bodies(mines, lane, bench, rng)
            ground = looks_at_some(lane, rings[id(lane)], rng.choice(free, 2000, replace=False))
            for some, label in ((mines, 1), (ground, 0)):
                shown.append(inputs(some, clutter, directions))
                labels.append(np.full(len(shown[-1]), label))
        model = MLPClassifier((64,), alpha=0.1, max_iter=60, early_stopping=True, random_state=0)
        fitted = make_pipeline(StandardScaler(), model)
        return clutter, directions, fitted.fit(np.concatenate(shown), np.concatenate(labels))

    learnt = bench.by_site(learn)

    def value(lane: Lane) -> np.ndarray:
        clutter, directions, network = learnt[lane.site]
        everywhere = Looks(
            lane.place, lane.metre, lane.weight, lane.chip, rings[id(lane)], lane.places
        )
        p = network.predict_proba(inputs(everywhere, clutter, directions))[:, 1].astype(float)
        p = np.clip(p, 1e-9, 1 - 1e-9)
        return lane.mean(np.log(p) - np.log1p(-p))

    bench.tell("injected bodies, network on whitened chips of a look", value)


class Bank:
    """Signatures with which the looks at a place are compared, one and the same in all of them.

    The statistic is the mixture over chosen signatures and over powers, phases of looks unknown.
    """

    POWERS = (10.0, 30.0, 100.0, 300.0)
    MOVES = (-0.08, -0.04, 0.0, 0.04, 0.08)  # m ahead

    def __init__(self, lane: Lane, clutter: Clutter, signatures: dict[str, Signatures]) -> None:
        self.lane = lane
        self.clutter = clutter
        parts, names, soils, copies, moves = [], [], [], [], []
        for name, of_body in signatures.items():
            plain = of_body.in_units(lane)[:, :, :, list(clutter.bands)]
            for move in self.MOVES:
                chips = plain * phases_of(np.full(plain.shape[:2], move), clutter.bands)
                chips = of_body.by_metre(chips).reshape(len(chips), METRES, -1)
                white = [chips[:, m] @ clutter.whitener[m].T for m in range(METRES)]
                parts.append(np.stack(white, axis=1))
                names += [name] * len(chips)
                soils += of_body.soil.tolist()
                copies += range(len(chips))
                moves += [move] * len(chips)
        bank = np.concatenate(parts)
        self.bank = (bank / np.linalg.norm(bank, axis=2)[:, :, None]).astype(np.complex64)
        self.names = np.array(names)
        self.soils = np.array(soils)
        self.copies = np.array(copies)
        self.moves = np.array(moves)
        order = np.argsort(lane.place, kind="stable")
        self.first = np.flatnonzero(np.diff(lane.place[order], prepend=-1))
        self.seen = lane.place[order][self.first]
        self.ground = self.shares(clutter.white(lane), lane.metre)[order]
        self._thresholds: dict[bytes, float] = {}

    def shares(self, white: np.ndarray, metre: np.ndarray) -> np.ndarray:
        """Return the shares (look, signature) of the power of whitened looks."""
        found = np.empty((len(white), len(self.bank)), np.float32)
        for number in np.unique(metre):
            at = metre == number
            found[at] = np.abs(white[at] @ self.bank[:, number].conj().T) ** 2
        return found / (np.abs(white) ** 2).sum(axis=1)[:, None]

    def statistic(self, share: np.ndarray, first: np.ndarray) -> np.ndarray:
        """Return the statistic of places whose looks begin at rows ``first``."""
        by_power = []
        for power in self.POWERS:
            rest = np.maximum(1 - share * (power / (1 + power)), 1e-6)
            by_look = -self.clutter.values * np.log(rest) - math.log1p(power)
            by_power.append(np.add.reduceat(by_look, first, axis=0))
        return logsumexp(np.concatenate(by_power, axis=1), axis=1)

    def threshold(self, chosen: np.ndarray) -> float:
        """Return the statistic of chosen signatures at 0.02 false alarms per m² on the lane."""
        key = chosen.tobytes()
        if key not in self._thresholds:
            lane = self.lane
            values = np.full(lane.places, -np.inf)
            values[self.seen] = self.statistic(self.ground[:, chosen], self.first)
            places, height = alarms_of(lane, values.reshape(lane.rows, lane.columns))
            false = np.sort(height[distances(places, lane.targets) > HALO])[::-1]
            self._thresholds[key] = float(false[int(RATE * lane.area())])
        return self._thresholds[key]

    def banks(self, body: str, copy: int, soil: int) -> tuple[np.ndarray, ...]:
        """Return which signatures are compared, from the body's own to all of them."""
        is_body = self.names == body
        own = is_body & (self.copies == copy)
        in_soil = self.soils == soil
        return (
            own & (self.moves == 0),
            is_body & in_soil & ~own,
            is_body & ~own,
            in_soil & ~own,
            ~own,
            np.ones(len(own), bool),
        )

    def found(self, body: str, of_body: Signatures, soil: int) -> np.ndarray:
        """Return which bodies are found at drawn places of the lane (body, bank)."""
        rng = np.random.default_rng(51)
        free = free_places(self.lane)
        own = of_body.by_metre(of_body.in_units(self.lane))
        some = (of_body.soil == soil) & (of_body.depth > -0.1)
        hits = []
        for copy in np.flatnonzero(some)[::2]:
            no_ring = np.zeros((len(self.lane.chip), 1))
            looks = looks_at_some(self.lane, no_ring, rng.choice(free, 20))
            looks.chip += own[copy][looks.metre]
            chips = looks.chip[:, :, list(self.clutter.bands)].reshape(len(looks.chip), -1)
            share = self.shares(self.clutter.whitened(chips, looks.metre), looks.metre)
            first = np.searchsorted(looks.place, np.arange(looks.count))
            for chosen in self.banks(body, int(copy), soil):
                hits.append(self.statistic(share[:, chosen], first) > self.threshold(chosen))
        banks = len(self.banks(body, 0, soil))
        return np.array(hits).reshape(-1, banks, 20).swapaxes(1, 2).reshape(-1, banks)


def try_ignorance(bench: Bench) -> None:
    """Tell how often a body put into measured ground is found, by what is known of it.

    The threshold is that of 0.02 false alarms per m² of the same signatures on the same lane.
    """
    nearest_soil = {"sand": 0, "earth": 2, "gravel": 1}  # to the site's; few are found in clay
    print(f"\n{bench.tier}: share found of bodies put into the lane `plastic` of a site\n")
    heads = (
        "site",
        "body",
        "itself",
        "other copies",
        "all soils",
        "all bodies, its soil",
        "all others",
        "all",
    )
    print(f"| {' | '.join(heads)} |\n|{'---|' * len(heads)}")
    for lane in bench.lanes:
        if lane.design != "plastic" or lane.site not in nearest_soil:
            continue
        bank = Bank(lane, bench.trained[lane.site].clutter(FOUR), bench.signatures)
        for body in ("metal", "tm-62p", "vs-1.6", "m19"):
            found = bank.found(body, bench.signatures[body], nearest_soil[lane.site])
            cells = " | ".join(f"{value:.2f}" for value in found.mean(axis=0))
            print(f"| {lane.site} | {body} | {cells} |", flush=True)


EXPERIMENTS = {
    "bands": try_bands,
    "weights": try_weights,
    "covariance": try_covariance,
    "looks": try_looks,
    "offsets": try_offsets,
    "injected": try_injected,
    "chips": try_chips,
    "ignorance": try_ignorance,
}


def reference(bench: Bench) -> None:
    """Tell of the reference, `fused` on the raster: three sub-bands, metal, twice the contrast."""
    learnt = bench.by_site(lambda trained: trained.classes(LOW))

    def value(lane: Lane) -> np.ndarray:
        clutter, directions = learnt[lane.site]
        found = ratios_of(clutter.white(lane), lane.metre, directions["metal"])
        return lane.mean(found + 2 * level(lane))

    bench.tell("**`fused`, on the raster**", value)


def main(arguments: list[str] | None = None) -> None:
    """Try the variants, and print their tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("ground", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--tier", action="append")
    parser.add_argument("--only", action="append", choices=EXPERIMENTS)
    parser.add_argument("--without-further", action="store_true")
    given = parser.parse_args(arguments)
    given.out.mkdir(parents=True, exist_ok=True)
    signatures = {name: simulate_signatures(name, given.out) for name in BODIES}
    for tier in given.tier or load_ground().table.tiers:
        lanes = load_lanes(given.ground, given.out, tier, not given.without_further)
        bench = Bench(tier, lanes, signatures)
        reference(bench)
        for name in given.only or EXPERIMENTS:
            EXPERIMENTS[name](bench)


if __name__ == "__main__":
    main()
