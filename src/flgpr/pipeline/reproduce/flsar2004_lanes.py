"""The lanes of flsar2004: simulated, imaged stop by stop, and laid out as one image per polarization and range."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Callable
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict

from flgpr.clutter import self_signature
from flgpr.clutter.background import scan_gain
from flgpr.imaging import ImagingOperator
from flgpr.model import Grid, Sensor, Tones, lane_to_scan, load_sensor, vehicle_to_scan
from flgpr.screen import sample_scan
from flgpr.simulate import Scene
from flgpr.simulate.scene import Clutter, Target, TargetDraw, Thing, Track
from flgpr.simulate.simulator import Simulator

FloatArray = NDArray[np.float64]
Progress = Callable[[str], None]


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class Mines(_Table):
    """Mines at one depth: how many of each kind at each site."""

    depth: float
    metal: int
    plastic: int


class Features(_Table):
    """Regions, templates and the subset that makes them."""

    region: tuple[float, float]
    template: tuple[float, float]
    magnitude: bool
    share: float
    keep_off: float


class Prescreen(_Table):
    """Prescreeners and what counts as a hit."""

    radius: float
    pass_share: float
    halo: float


class Classify(_Table):
    """Classifiers: what is chosen inside training folds, and the size of the bootstrap."""

    folds: int
    widths: tuple[float, ...]
    costs: tuple[float, ...]
    degrees: tuple[int, ...]
    p0: float
    bootstrap: int


class Settings(_Table):
    """All that the experiment depends on."""

    name: str
    seed: int
    sensor: str
    tones: tuple[float, float, int]
    footprint: tuple[float, float, float, float]
    window: str
    sites: tuple[str, ...]
    ranges: tuple[float, ...]
    step: float
    lane: tuple[float, float]
    pitch: float
    spacing: tuple[float, float]
    margin: float
    fiducial_x: float
    fiducial_pitch: float
    fiducial_rcs: float
    mines: tuple[Mines, ...]
    features: Features
    prescreen: Prescreen
    classify: Classify

    @property
    def length(self) -> float:
        """Length of a lane, m."""
        return self.pitch * sum(mines.metal + mines.plastic for mines in self.mines)


def load_settings(quick: bool = False) -> Settings:
    """Read the packaged settings; ``quick`` keeps a third of the mines and a quarter of the bootstrap."""
    text = (resources.files("flgpr.pipeline.reproduce") / "flsar2004.toml").read_text(encoding="utf-8")
    settings = Settings.model_validate(tomllib.loads(text))
    if not quick:
        return settings
    fewer = tuple(
        Mines(depth=m.depth, metal=max(m.metal // 3, 2), plastic=max(m.plastic // 3, 2)) for m in settings.mines
    )
    classify = settings.classify.model_copy(update={"bootstrap": settings.classify.bootstrap // 4, "folds": 5})
    return settings.model_copy(update={"mines": fewer, "classify": classify})


@dataclass(frozen=True)
class Pass:
    """One drive along a lane.

    Attributes
    ----------
    site : str
        Where.
    direction : str
        "out" or "back"; the frame is that of the drive.
    image : (polarization, range, y, x) ndarray of float32
        Magnitudes, in units of the scans' gain.
    grid : Grid
        Pixels.
    truth, fiducials : DataFrame
        Mines and fiducials in the frame of the drive.
    """

    site: str
    direction: str
    image: NDArray[np.float32]
    grid: Grid
    truth: pd.DataFrame
    fiducials: pd.DataFrame


def drive(settings: Settings, site: str, progress: Progress, folder: Path | None = None) -> list[Pass]:
    """Drive a site's lane in both directions, or read the images of an earlier drive from ``folder``."""
    sensor = load_sensor(settings.sensor)
    start, step, count = settings.tones
    sensor = sensor.model_copy(
        update={"tones": Tones(start=start, step=step, count=int(count)), "footprint": settings.footprint}
    )
    seed = settings.seed + 10 * settings.sites.index(site)
    out = Simulator(_scene(settings, site), sensor, seed)
    back = Simulator(_turned(settings, site, out), sensor, seed + 1)
    return [
        _one_pass(settings, site, name, simulator, sensor, progress, folder)
        for name, simulator in (("out", out), ("back", back))
    ]


def _scene(settings: Settings, site: str) -> Scene:
    draws = [
        TargetDraw(kind=kind, depth=mines.depth, count=count, position_jitter=0.2)
        for mines in settings.mines
        for kind, count in (("metal", mines.metal), ("plastic", mines.plastic))
    ]
    fiducials = tuple(
        Thing(kind="fiducial", x=side * settings.fiducial_x, y=float(y), height=0.3, rcs_db=settings.fiducial_rcs)
        for y in np.arange(settings.fiducial_pitch / 2, settings.length, settings.fiducial_pitch)
        for side in (-1, 1)
    )
    return Scene(
        name=site, site=site, x_min=settings.lane[0], x_max=settings.lane[1], length=settings.length,
        draws=tuple(draws), objects=fiducials, track=_track(settings),
    )  # fmt: skip


def _track(settings: Settings) -> Track:
    first = -settings.ranges[-1] - settings.step
    last = settings.length - settings.ranges[0] + settings.step
    return Track(positions=tuple(np.arange(first, last + 0.1, settings.step).tolist()))


def _turned(settings: Settings, site: str, out: Simulator) -> Scene:
    """Turn mines, stones and posts about, as a vehicle sees them that comes from the other end."""

    def turn(thing: Any) -> Any:
        update = {"x": -thing.x, "y": settings.length - thing.y}
        if isinstance(thing, Target):
            update["azimuth"] = thing.azimuth + math.pi
        return thing.model_copy(update=update)

    world = out.world
    return Scene(
        name=site, site=site, x_min=settings.lane[0], x_max=settings.lane[1], length=settings.length,
        targets=tuple(map(turn, world.targets)), objects=tuple(map(turn, world.objects)),
        patches=tuple(map(turn, world.patches)), clutter=Clutter(rocks=0, bushes=0, posts=0, patches=0),
        track=_track(settings),
    )  # fmt: skip


def _one_pass(
    settings: Settings, site: str, direction: str, simulator: Simulator, sensor: Sensor, progress: Progress,
    folder: Path | None,
) -> Pass:  # fmt: skip
    m, (dx, dy) = settings.margin, settings.spacing
    x = np.arange(settings.lane[0] - m, settings.lane[1] + m + dx / 2, dx)
    grid = Grid(float(x[0]), -m, x.size, round((settings.length + 2 * m) / dy) + 1, dx, dy)
    path = None if folder is None else folder / f"{site}-{direction}.npz"
    if path is not None and path.is_file():
        image = np.load(path, allow_pickle=False)["image"]
    else:
        image = lane_images(settings, simulator, sensor, grid, lambda text: progress(f"{site} {direction}: {text}"))
        if path is not None:
            np.savez_compressed(path, image=image)
    objects = simulator.objects
    fiducials = objects[objects["kind"] == "fiducial"].reset_index(drop=True)
    return Pass(site, direction, image, grid, simulator.truth.reset_index(drop=True), fiducials)


def lane_images(
    settings: Settings, simulator: Simulator, sensor: Sensor, grid: Grid, progress: Progress
) -> NDArray[np.float32]:
    """Image every stop, take the self-signature off, and put together one lane image per polarization and range.

    A pixel of the image of range d comes from the stop that sees it within half a step of d.
    """
    half = settings.step / 2 + 0.75
    nx = round((grid.x[-1] - grid.x[0] + 0.4) / grid.dx) + 1
    ny = round((settings.ranges[-1] - settings.ranges[0] + 2 * half) / grid.dy) + 1
    view = Grid(float(grid.x[0]) - 0.2, settings.ranges[0] - half, nx, ny, grid.dx, grid.dy)
    pose = simulator.reported_pose()
    tx, rx = sensor.pairs()
    level = pose[0].copy()
    operator = ImagingOperator(
        simulator.frequency, vehicle_to_scan(tx, level), vehicle_to_scan(rx, level), view.points(),
        window=settings.window,
    )  # fmt: skip
    images = []
    for index in range(len(pose)):
        images.append(operator.adjoint(simulator.scan(index))[:, 0])
        progress(f"stop {index + 1} of {len(pose)}")
    signature = self_signature(images, "median")
    lane = np.zeros((images[0].shape[0], len(settings.ranges), *grid.shape), np.float32)
    points = grid.points()
    for image, where in zip(images, pose, strict=True):
        clean = _labelled(image / scan_gain(image) - signature, view)
        local = lane_to_scan(points, where)
        for k, distance in enumerate(settings.ranges):
            rows = np.abs(local[:, 0, 1] - distance) <= settings.step / 2
            if rows.any():
                lane[:, k, rows] = np.nan_to_num(sample_scan(clean, local[rows]))
    return lane


def _labelled(image: NDArray[np.complex64], view: Grid) -> xr.DataArray:
    return xr.DataArray(image, dims=("polarization", "y", "x"), coords={"y": view.y, "x": view.x})
