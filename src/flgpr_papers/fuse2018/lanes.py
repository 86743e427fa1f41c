"""The lanes of Fuse et al. 2018, simulated, and their frames: two runs with shared poses, aperture by aperture."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

from flgpr.chain.progress import Track
from flgpr.clutter import FrameStack, standing_field, subregions, subtract_standing
from flgpr.imaging import ImagingOperator
from flgpr.io import open_run
from flgpr.model import Grid, Sensor, check_run, check_shared_poses, complete_scans, load_sensor, vehicle_to_lane
from flgpr.simulate import Scene, Simulator, draw_world
from flgpr_papers.fuse2018.recipe import FuseRecipe, Image
from flgpr_papers.kit.cache import key_of, read_arrays, store_lane, write_arrays
from flgpr_papers.kit.lanes import told

BANDS = ("l", "x")
ComplexArray = NDArray[np.complex64]
FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]


def band_sensor(recipe: FuseRecipe, band: str) -> Sensor:
    """Load a band's preset with the study's navigation and footprint."""
    preset = load_sensor(f"dual-band-{band}")
    errors = preset.errors.model_copy(update={"position": recipe.radar.position, "heading": recipe.radar.heading})
    return preset.model_copy(update={"errors": errors, "footprint": recipe.radar.footprint})


def lane_scene(recipe: FuseRecipe, name: str, band: str, quick: bool = False) -> Scene:
    """Describe a lane as a band sees it; the bands differ in the density of surface scatterers alone."""
    lanes = recipe.lanes
    density = recipe.radar.scatterers_x if band == "x" or quick else None
    return Scene.model_validate(
        {
            "name": f"{name}-{band}",
            "site": lanes.site,
            "x_min": -lanes.half_width,
            "x_max": lanes.half_width,
            "length": lanes.length,
            "surface": {"density": density},
            "clutter": {"bushes": lanes.bushes, "posts": lanes.posts, "roadside": lanes.roadside},
            "draws": [{"kind": "metal", "depth": depth, "count": lanes.mines} for depth in lanes.depths],
            "track": {"start": lanes.start, "step": lanes.step, "wander": lanes.wander},
        }
    )


@dataclass(frozen=True)
class Frames:
    """A lane's frames in both bands, self-signature taken off, and what is there."""

    name: str
    frequency: dict[str, FloatArray]  #: tones of each band, Hz
    #: VV and VH of the L band under "l", VV of the X band under "x"; a single-band radar has no "x"
    data: dict[str, ComplexArray]
    #: tx, rx: antenna positions in the vehicle frame, m
    tx: dict[str, FloatArray]
    rx: dict[str, FloatArray]
    pose: dict[str, FloatArray]  #: reported poses of each band's reference point
    #: truth, objects: what is in and beside the lane; for calibration and scoring
    truth: pd.DataFrame
    objects: pd.DataFrame
    #: (frame, 1, pair, frequency) what the mines alone add to VV of the L band, without errors of the radar; to tell
    #: what becomes of it
    mines: ComplexArray | None = None

    def __len__(self) -> int:
        return len(self.pose["l"])

    def operator_on(self, frame: int, band: str = "l") -> Callable[[FloatArray], ImagingOperator]:
        """Give the maker of a frame's operators on points of the lane frame."""
        pose, tolerance = self.pose[band][frame], 1e-3 if band == "l" else 1e-2
        tx, rx = vehicle_to_lane(self.tx[band], pose), vehicle_to_lane(self.rx[band], pose)
        return lambda points: ImagingOperator(self.frequency[band], tx, rx, points, tolerance=tolerance)


def simulate_lane(folder: Path, recipe: FuseRecipe, name: str, quick: bool, track: Track) -> Frames:
    """Simulate both bands of a lane into run stores, unless they are there, and read them."""
    seed = recipe.lanes.seeds[name]
    runs = {}
    for band in BANDS:
        store, _, _ = store_lane(folder, lane_scene(recipe, name, band, quick), seed, band_sensor(recipe, band), track)
        runs[band] = open_run(store)
    world = draw_world(lane_scene(recipe, name, "l", quick), seed)
    mines = mines_alone(folder, recipe, name, quick, track) if name != "calibration" else None
    return read_frames(name, runs, world.truth(), world.objects_table(), mines)


def mines_alone(folder: Path, recipe: FuseRecipe, name: str, quick: bool, track: Track) -> ComplexArray:
    """Simulate what the mines add to VV of every scan: the lane less its twin that has everything but the mines."""
    sensor, seed = band_sensor(recipe, "l").model_copy(update={"polarization": ("VV",)}), recipe.lanes.seeds[name]
    scene = lane_scene(recipe, name, "l", quick)
    lane = told(scene, seed)
    twins = [Scene.model_validate(one) for one in (lane, lane | {"targets": []})]
    key = key_of([twin.model_dump(mode="json") for twin in twins], sensor.model_dump(mode="json"), seed)
    path = folder / f"{name}-mines-{key}.bundle"
    if not path.is_file():
        full, empty = (Simulator(twin, sensor, seed, errors=False) for twin in twins)
        scans = track(range(len(full)), f"mines of lane {name}", len(full))
        write_arrays(path, {"signal": np.stack([full.scan(k) - empty.scan(k) for k in scans])})
    return read_arrays(path)["signal"]


def read_frames(
    name: str,
    runs: dict[str, xr.Dataset],
    truth: pd.DataFrame,
    objects: pd.DataFrame,
    mines: ComplexArray | None = None,
) -> Frames:
    """Read a lane's runs into memory: the frames that are complete in all bands."""
    check_shared_poses(runs)
    good = np.logical_and.reduce([complete_scans(check_run(run)) for run in runs.values()])
    if not good.any():
        raise ValueError(f"run {name} must have a frame without missing sweeps in all bands, got none of {good.size}")
    data, frequency, tx, rx, pose = {}, {}, {}, {}, {}
    for band, run in runs.items():
        wanted = ["VV", "VH"] if band == "l" else ["VV"]
        missing = [p for p in wanted if p not in run["polarization"].values]
        if missing:
            raise ValueError(f"run {name} must have the polarizations {', '.join(wanted)}, {missing[0]} is missing")
        signal = np.asarray(run["signal"].sel(polarization=wanted).values[good], dtype=np.complex64)
        data[band] = subtract_standing(signal, standing_field(signal))
        frequency[band] = np.asarray(run["frequency"].values, dtype=np.float64)
        tx[band], rx[band] = run["tx_position"].values, run["rx_position"].values
        pose[band] = np.asarray(run["pose"].values, dtype=np.float64)[good]
    return Frames(name, frequency, data, tx, rx, pose, truth, objects, None if mines is None else mines[good])


@dataclass(frozen=True)
class Aperture:
    """Consecutive frames that are summed coherently, and the ground ahead of the latest."""

    frames: tuple[int, ...]  #: frames, the latest last
    grid: Grid  #: pixels in the lane frame
    origin: tuple[float, float]  #: (x, y) where the array stands in the latest frame, m
    region: NDArray[np.int64]  #: (y, x) sub-region in range of every pixel
    operators: Sequence[Callable[[FloatArray], ImagingOperator]]  #: per frame, the maker of its L-band operator
    data: ComplexArray  #: (frame, 1, pair, frequency) VV of the L band
    looks: ComplexArray  #: (frame, y, x) VV image of every frame
    #: vv, vh: (y, x) coherent sums over the frames (Eq. 4)
    vv: ComplexArray
    vh: ComplexArray
    #: (y, x) X band: mean magnitude over the frames, since its wavelength is too short for the poses (see the page)
    x: NDArray[np.float32] | None

    def stack_on(self, points: FloatArray) -> FrameStack:
        """Make the operator of all frames on points of the lane frame."""
        return FrameStack([make(points) for make in self.operators])

    @property
    def across(self) -> FloatArray:
        """Distance of every pixel from the array's middle, m."""
        return np.broadcast_to(self.grid.x - self.origin[0], self.grid.shape)

    @property
    def ahead(self) -> FloatArray:
        """Distance of every pixel ahead of the array, m."""
        return np.broadcast_to((self.grid.y - self.origin[1])[:, None], self.grid.shape)

    def halo(self, x: float, y: float, radius: float) -> BoolArray:
        """Mark the pixels within a radius of a place, m."""
        return np.asarray((self.grid.x[None, :] - x) ** 2 + (self.grid.y[:, None] - y) ** 2 <= radius**2)


def aperture(frames: Frames, latest: int, image: Image) -> Aperture:
    """Image the aperture that ends with a frame."""
    used = tuple(range(latest - image.frames + 1, latest + 1))
    pose = frames.pose["l"][latest]
    # Pixels of all apertures lie on one raster, so that a lane's map needs no interpolation.
    start = round(float(pose[1] + image.y[0]) / image.spacing) * image.spacing
    grid = Grid.spanning(image.x, (start, start + image.y[1] - image.y[0]), image.spacing)
    pixels = grid.points()
    makes = [frames.operator_on(f) for f in used]
    data = frames.data["l"]
    looks = np.stack([make(pixels).adjoint(data[f])[:, 0] for f, make in zip(used, makes, strict=True)])
    vv, vh = looks.sum(axis=0)
    second = None
    if "x" in frames.data:
        strengths = [np.abs(frames.operator_on(f, "x")(pixels).adjoint(frames.data["x"][f])[0, 0]) for f in used]
        second = np.asarray(np.mean(strengths, axis=0), dtype=np.float32)
    region = subregions(np.broadcast_to((grid.y - start + image.y[0])[:, None], grid.shape), image.edges)
    origin = (float(pose[0]), start - image.y[0])
    return Aperture(used, grid, origin, region, makes, data[list(used), :1], looks[:, 0], vv, vh, second)
