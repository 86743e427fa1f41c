"""Lanes of proving ground 2 that are not test lanes, and all looks at the places of a raster on them."""

from __future__ import annotations

import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from flgpr.method.imaged_run import ImagedRun
from flgpr.method.method import engine_of
from flgpr.model import Grid, load_sensor
from flgpr.recipe.schema import parse_recipe, recipe_text
from flgpr.stages.likelihood import LikelihoodSettings, contrasts
from flgpr.store import open_run
from flgpr_ground.ground import GroundLane, LaneRow, load_ground
from flgpr_ground.oracle import STEP, chips_at, places_in_sight

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
LOW = (0, 1, 2)  # sub-bands of `fused`
FOUR = (0, 1, 2, 3)
NEAREST = 7.0  # m, the first row of the images
METRES = 9  # looks lie between 7 and 16 m ahead
HEIGHT = 5.0  # m, of the array
RATES = (0.005, 0.01, 0.02, 0.05)  # per m²
RATE = 0.02
HALO = 1.0  # m
NAVIGATION = 0.022  # m along the line of sight: errors of place, and pixels of 0.05 m


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
        seen = weighted_means(self.place, weights, values, self.places)
        return seen.reshape(self.rows, self.columns)

    def area(self) -> float:
        """Return the area in which alarms are false, m²."""
        fine = 0.05
        x = np.arange(self.x_min, self.x_min + STEP * (self.columns - 1) + 1e-9, fine)
        y = np.arange(self.y_min, self.y_min + STEP * (self.rows - 1) + 1e-9, fine)
        points = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
        far = distances(points, self.targets) > HALO
        return float(far.mean()) * STEP**2 * self.columns * (self.rows - 1)


def weighted_means(
    place: np.ndarray, weights: np.ndarray, values: np.ndarray, count: int
) -> np.ndarray:
    """Return the weighted mean (place,) of the values of looks; NaN where there is none."""
    total = np.bincount(place, weights * values, count)
    weight = np.bincount(place, weights, count)
    return np.where(weight > 0, total / np.maximum(weight, 1e-30), np.nan)


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
    setup = ImagedRun(open_run(store), images_recipe(), lane.lane, explains=False)
    engine_of(setup).run(names=("signature", "gain"))
    borders = lane.lane
    raster = Grid.spanning((borders.x_min, borders.x_max), (borders.y_min, borders.y_max), STEP)
    points = raster.points().reshape(-1, 3)
    table = LikelihoodSettings(sensor="sri-array")
    parts: dict[str, list] = {name: [] for name in ("place", "scan", "xy", "chip", "contrast")}
    for index in range(len(setup)):
        image = setup.coherent(index)
        numbers, places = places_in_sight(setup, points, image.attrs["pose"])
        if not len(numbers):
            continue
        row = np.round((places[:, 1] - setup.near.y_min) / setup.near.dy).astype(int)
        column = np.round((places[:, 0] - setup.near.x_min) / setup.near.dx).astype(int)
        shown = np.moveaxis(contrasts(image, table)[:, :, row, column], 2, 0)
        parts["place"].append(numbers)
        parts["scan"].append(np.full(len(numbers), index))
        parts["xy"].append(places)
        parts["chip"].append(chips_at(image.values, setup.near, places))
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
