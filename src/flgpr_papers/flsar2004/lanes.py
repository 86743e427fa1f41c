"""The lanes of flsar2004.

Simulated, imaged stop by stop, and laid out as one image per polarization and range.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from flgpr.chain.progress import Track, silent
from flgpr.clutter import self_signature
from flgpr.clutter.background import scan_gain
from flgpr.imaging import ImagingOperator
from flgpr.kernels.sampling import bilinear
from flgpr.model import (
    SPEED_OF_LIGHT,
    Grid,
    Sensor,
    Tones,
    check_tones,
    lane_to_scan,
    load_sensor,
    vehicle_to_scan,
)
from flgpr.simulate import Scene
from flgpr.simulate.scene.scene import SceneObject, Surface, TargetDraw
from flgpr.simulate.scene.scene import Track as Drive
from flgpr.simulate.simulator import Simulator
from flgpr_papers.kit.cache import key_of, read_arrays, write_arrays
from flgpr_papers.kit.settings import Table, packaged
from flgpr_papers.kit.study_worlds import OWN, study_world
from flgpr_papers.kit.worlds import turned

FloatArray = NDArray[np.float64]
# m of a stop's image beyond the lane's, across, and beyond half a step, along
_SIDE = 0.2
_BEYOND = 0.75
# image pixels of a stop per pixel of the lane, down-track: the lane's pixels are interpolated
# between them
FINER = 2


class Mines(Table):
    """Mines at one depth: how many of each kind at each site."""

    depth: float
    metal: int
    plastic: int


class Features(Table):
    """Regions, templates and the subset that makes them."""

    region: tuple[float, float]
    template: tuple[float, float]
    share: float
    keep_off: float


class Prescreen(Table):
    """Prescreeners and what counts as a hit."""

    radius: float
    pass_share: float
    halo: float


class Classify(Table):
    """Classifiers: what is chosen inside training folds, and the size of the bootstrap."""

    folds: int
    widths: tuple[float, ...]
    costs: tuple[float, ...]
    degrees: tuple[int, ...]
    p0: float
    bootstrap: int
    examples: tuple[int, int]


class Settings(Table):
    """All that the experiment depends on.

    ``scenes`` gives the packaged site, or the path of one, of every site.
    """

    name: str
    seed: int
    sensor: str
    density: float | None = None
    tones: tuple[float, float, int]
    footprint: tuple[float, float, float, float]
    window: str
    sites: tuple[str, ...]
    scenes: dict[str, str]
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


def load_settings(quick: bool = False, world: str = OWN) -> Settings:
    """Read the packaged settings on the lanes of a world.

    ``quick`` takes few mines, tones and draws, which only show that all of it runs.
    """
    return packaged("flsar2004", Settings, quick, {"scenes": study_world("flsar2004", world).sites})


@dataclass(frozen=True)
class Pass:
    """One drive along a lane."""

    site: str
    direction: str  #: "out" or "back"; the frame is that of the drive
    #: (polarization, range, y, x) in units of the scans' gain; the phase that the way to the pixel
    #: turns at the middle of the band is taken out
    image: NDArray[np.complex64]
    grid: Grid  #: pixels
    #: truth, fiducials: mines and fiducials in the frame of the drive
    truth: pd.DataFrame
    fiducials: pd.DataFrame
    key: str = ""  #: digest of what the images were made of


def drive(settings: Settings, site: str, folder: Path, track: Track = silent) -> list[Pass]:
    """Return a site's lane driven in both directions.

    Images of the same drive are read from a folder.
    """
    sensor = study_sensor(settings)
    seed = settings.seed + 10 * settings.sites.index(site)
    scene = _scene(settings, site)
    out = Simulator(scene, sensor, seed)
    other = turned(scene, seed)
    back = Simulator(other, sensor, seed + 1)
    folder.mkdir(parents=True, exist_ok=True)
    passes = []
    for name, simulator, world in (("out", out, scene), ("back", back, other)):
        imaging = {
            key: getattr(settings, key)
            for key in ("ranges", "step", "lane", "spacing", "margin", "window")
        }
        content = {
            "scene": world.model_dump(mode="json"),
            "sensor": sensor.model_dump(mode="json"),
            "seed": seed,
            "imaging": imaging,
            "length": settings.length,
        }
        path = folder / f"{site}-{name}-{key_of(content)}.bundle"
        passes.append(_one_pass(settings, site, name, simulator, sensor, path, track))
    return passes


def study_sensor(settings: Settings) -> Sensor:
    """Make the radar of the study.

    The preset on the study's tones, which must keep its images free of aliases.
    """
    start, step, count = settings.tones
    sensor = load_sensor(settings.sensor).model_copy(
        update={
            "tones": Tones(start=start, step=step, count=int(count)),
            "footprint": settings.footprint,
        }
    )
    side = settings.lane[0] - settings.margin - _SIDE, settings.lane[1] + settings.margin + _SIDE
    half = settings.step / 2 + _BEYOND
    check_tones(sensor, side, (settings.ranges[0] - half, settings.ranges[-1] + half))
    return sensor


def _scene(settings: Settings, site: str) -> Scene:
    """Return the scene of a site's lane."""
    draws = [
        TargetDraw(kind=kind, depth=mines.depth, count=count, position_jitter=0.2)
        for mines in settings.mines
        for kind, count in (("metal", mines.metal), ("plastic", mines.plastic))
    ]
    fiducials = tuple(
        SceneObject(
            kind="fiducial",
            x=side * settings.fiducial_x,
            y=float(y),
            height=0.3,
            rcs_db=settings.fiducial_rcs,
        )
        for y in np.arange(settings.fiducial_pitch / 2, settings.length, settings.fiducial_pitch)
        for side in (-1, 1)
    )
    return Scene(
        name=site,
        site=settings.scenes[site],
        x_min=settings.lane[0],
        x_max=settings.lane[1],
        length=settings.length,
        draws=tuple(draws),
        objects=fiducials,
        track=_track(settings),
        surface=Surface(density=settings.density),
    )


def _track(settings: Settings) -> Drive:
    """Return the stops of a drive."""
    first = -settings.ranges[-1] - settings.step
    last = settings.length - settings.ranges[0] + settings.step
    return Drive(positions=tuple(np.arange(first, last + 0.1, settings.step).tolist()))


def _one_pass(
    settings: Settings,
    site: str,
    direction: str,
    simulator: Simulator,
    sensor: Sensor,
    path: Path,
    track: Track,
) -> Pass:
    """Return the lane images of a drive in one direction, or read them from a folder."""
    m = settings.margin
    dx, dy = settings.spacing
    x = np.arange(settings.lane[0] - m, settings.lane[1] + m + dx / 2, dx)
    grid = Grid(float(x[0]), -m, x.size, round((settings.length + 2 * m) / dy) + 1, dx, dy)
    if path.is_file():
        image = read_arrays(path)["image"]
    else:
        stops = track(
            range(len(simulator.reported_pose())),
            f"{site} {direction}",
            len(simulator.reported_pose()),
        )
        image = lane_images(settings, simulator, sensor, grid, stops)
        write_arrays(path, {"image": image})
    objects = simulator.objects
    fiducials = objects[objects["kind"] == "fiducial"].reset_index(drop=True)
    return Pass(
        site, direction, image, grid, simulator.truth.reset_index(drop=True), fiducials, path.stem
    )


def lane_images(
    settings: Settings, simulator: Simulator, sensor: Sensor, grid: Grid, stops: Iterable[int]
) -> NDArray[np.complex64]:
    """Image every stop and join one lane image per polarization and range.

    The self-signature is subtracted.

    A pixel of the image of range d comes from the stop that sees it within half a step of d. The
    phase of the middle of the band is taken out, so that neighbouring pixels differ little and
    signatures at any distance are alike.
    """
    half = settings.step / 2 + _BEYOND
    nx = round((grid.x[-1] - grid.x[0] + 2 * _SIDE) / grid.dx) + 1
    ny = round((settings.ranges[-1] - settings.ranges[0] + 2 * half) * FINER / grid.dy) + 1
    view = Grid(
        float(grid.x[0]) - _SIDE, settings.ranges[0] - half, nx, ny, grid.dx, grid.dy / FINER
    )
    pose = simulator.reported_pose()
    tx, rx = (vehicle_to_scan(positions, pose[0]) for positions in sensor.pairs())
    operator = ImagingOperator(simulator.frequency, tx, rx, view.points(), window=settings.window)
    images = [operator.adjoint(simulator.scan(index))[:, 0] for index in stops]
    signature = self_signature(images, "median")
    middle = 2 * np.pi * float(np.mean(simulator.frequency)) / SPEED_OF_LIGHT
    path = 2 * np.linalg.norm(view.points() - (tx + rx).mean(axis=0) / 2, axis=-1)
    carrier = np.exp(-1j * middle * path).astype(np.complex64)
    lane = np.zeros((images[0].shape[0], len(settings.ranges), *grid.shape), np.complex64)
    points = grid.points()
    for image, where in zip(images, pose, strict=True):
        clean = ((image / scan_gain(image) - signature) * carrier).astype(np.complex64)
        local = lane_to_scan(points, where)
        for k, distance in enumerate(settings.ranges):
            rows = np.abs(local[:, 0, 1] - distance) <= settings.step / 2
            if rows.any():
                row = (local[rows][..., 1] - view.y_min) / view.dy
                column = (local[rows][..., 0] - view.x_min) / view.dx
                lane[:, k, rows] = np.nan_to_num(bilinear(clean, row, column))
    return lane
