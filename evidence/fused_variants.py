"""Variants of `fused`, tried on training and validation lanes of proving ground 2 with one site left out.

``python evidence/fused_variants.py GROUND OUT [--tier T] [--only NAME ...] [--without-further]`` reads the training and
validation lanes of a folder of ``flgpr benchmark run``. It never reads a test lane. It makes one further lane a site
(180 m, 40 mines of the sorts of the training lanes, seeds of its own), simulates signatures, and cuts the chips of all
looks at a raster of 0.2 m out of the cleaned images of seven sub-bands. What takes long is written to OUT once.

Everything that is learnt comes from the metal and plastic lanes of the three other sites of the tier. A variant is a
map on the raster: the mean over looks, weighted by the inverse square of their distance, smoothed by 0.15 m. Its local
maxima within 0.5 m are alarms. So the figures are near those of the recipe, not the same.

A row tells mines found at 0.005, 0.01, 0.02 and 0.05 false alarms per m², by kind; of all mines those that the variant
alone and the reference alone find at 0.02, with the p of McNemar's exact test; and the change against the reference of
the mean of log10 of the false alarms at which a mine is found, with its standard error.

Names of experiments: ``bands`` (sub-bands, classes of bodies), ``covariance`` (the lane's own), ``looks`` (several
looks jointly, with and without their phases), ``offsets`` (narrow subspaces for places beside the raster), ``injected``
(classifiers trained on simulated bodies put into measured ground), ``ignorance`` (what it costs not to know which
signature it is).
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
from flgpr.chain.stages.likelihood import LikelihoodSettings, contrasts, ratio
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

    def mean(self, values: np.ndarray) -> np.ndarray:
        """Return the weighted mean over looks (y, x) of a value of each."""
        total = np.bincount(self.place, self.weight * values, self.places)
        weight = np.bincount(self.place, self.weight, self.places)
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


def ground_lanes(folder: Path, out: Path, tier: str, further: bool) -> Iterator[tuple[GroundLane, Path]]:
    """Yield the lanes of a tier that are not test lanes, with their run stores."""
    (ground,) = load_ground().chosen_tiers(tier)
    for lane in ground.lanes.values():
        if lane.part != "test":
            yield lane, folder / "lanes" / f"{lane.name}.zarr"
    if not further:
        return
    for site, packaged in ground.table.tiers[tier].sites.items():
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
    tail = rest[rest.index("[run_view]") :].replace('polarization = "likelihood"', 'polarization = "HH"')
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
        np.savez(file, **dict(zip(("chip", "place", "depth", "soil", "beside"), joined, strict=True)))
    with np.load(file) as data:
        return Signatures(**data)


def _in_soil(name: str, soil: int) -> tuple[np.ndarray, ...]:
    """Simulate a body in one soil at all depths, every copy alone."""
    rng = np.random.default_rng([51, soil, zlib.crc32(name.encode())])
    depths = np.repeat(DEPTHS.get(name, OTHER_DEPTHS), COPIES)
    count = len(depths)
    apart = 100.0
    x = rng.uniform(-1.4, 1.4, count)
    y = apart * np.arange(count) + 30.0
    lean = rng.normal(0, math.radians(4), (count, 2))
    beside = rng.uniform(-STEP / 2, STEP / 2, (count, 2))
    heading = rng.uniform(0, 2 * math.pi, count)
    scans = (y[:, None] - LOOKS - rng.uniform(-0.3, 0.3, (count, len(LOOKS)))).ravel()
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
