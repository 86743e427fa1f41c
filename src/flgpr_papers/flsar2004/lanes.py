"""The lanes of flsar2004: simulated, imaged stop by stop, and joined to one image per range."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
import pandas as pd

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
from flgpr.progress import Track, silent
from flgpr.simulate import Scene
from flgpr.simulate.simulator import Simulator
from flgpr.types import ComplexArray
from flgpr_papers.kit.cache import key_of, read_arrays, write_arrays
from flgpr_papers.kit.scenes import turned
from flgpr_papers.kit.settings import Span, Table, packaged
from flgpr_papers.kit.study_worlds import OWN, study_world

RadiusIs = Literal["forming", "size"]
_SIDE = 0.2  # m of a stop's image beyond the lane's, cross-track
_BEYOND = 0.75  # m of a stop's image beyond half a step, down-track
# image pixels of a stop per pixel of the lane, down-track: the lane's pixels are interpolated
# between them
FINER = 2
# settings that the images depend on
_IMAGING = ("ranges", "step", "lane", "spacing", "margin", "window")


class Mines(Table):
    """Mines at one depth: how many of each kind at each site."""

    depth: float
    metal: int
    plastic: int


class Features(Table):
    """Regions, templates and the subset that makes them."""

    region: Span  #: size of a region, m
    template: Span  #: size of a template, m
    share: float  #: share of the mines in the subset
    keep_off: float  #: least distance of clutter from mines, m


class Prescreen(Table):
    """Prescreeners and what counts as a hit."""

    radius: float  #: the paper's 20 cm, m
    #: what they are (par. 15): that within which a cluster forms, or that of the least cluster
    radius_is: RadiusIs
    pass_share: float  #: share of the subset's mines that a threshold lets pass
    halo: float  #: largest distance of a hit from its mine, m


class Classify(Table):
    """Classifiers: what is chosen inside training folds, and the size of the bootstrap."""

    folds: int  #: groups of mines that are held out together
    widths: tuple[float, ...]  #: γ of RBF kernels, times the number of features
    costs: tuple[float, ...]  #: C of support vector machines
    degrees: tuple[int, ...]  #: of polynomial kernels
    p0: float  #: of the one-class machine
    bootstrap: int  #: number of draws
    examples: tuple[int, int]  #: mines and clutter examples of the paper's leave-one-out


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
    lane: Span
    pitch: float
    spacing: Span
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
    """Load the packaged settings on the lanes of a world.

    Parameters
    ----------
    quick : bool
        Few mines, tones and draws, which only show that everything runs.
    world : str
        World of the lanes, see `flgpr_papers.kit.study_worlds`.
    """
    return packaged("flsar2004", Settings, quick, {"scenes": study_world("flsar2004", world).sites})


@dataclass(frozen=True)
class Pass:
    """One drive along a lane."""

    site: str
    direction: str  #: "out" or "back"; the frame is that of the drive
    #: (polarization, range, y, x) in units of the scans' gain; the phase of the way to the pixel
    #: at the middle of the band is taken out
    image: ComplexArray
    grid: Grid  #: pixels
    truth: pd.DataFrame  #: mines in the frame of the drive
    fiducials: pd.DataFrame  #: fiducials in the frame of the drive
    key: str = ""  #: digest of what the images were made of


def drive(settings: Settings, site: str, folder: Path, track: Track = silent) -> list[Pass]:
    """Simulate a site's lane driven in both directions and image it.

    Parameters
    ----------
    settings : Settings
        The study.
    site : str
        Name of the site.
    folder : Path
        Folder of the lane images; images of the same drive are read from it.
    track : Track
        Shows progress.
    """
    sensor = study_sensor(settings)
    seed = settings.seed + 10 * settings.sites.index(site)
    scene = _scene(settings, site)
    margin = settings.margin
    dx, dy = settings.spacing
    x = np.arange(settings.lane[0] - margin, settings.lane[1] + margin + dx / 2, dx)
    ny = round((settings.length + 2 * margin) / dy) + 1
    grid = Grid(float(x[0]), -margin, x.size, ny, dx, dy)
    passes = []
    for number, (direction, driven) in enumerate((("out", scene), ("back", turned(scene, seed)))):
        simulator = Simulator(driven, sensor, seed + number)
        content = {
            "scene": driven.model_dump(mode="json"),
            "sensor": sensor.model_dump(mode="json"),
            "seed": seed,
            "imaging": {name: getattr(settings, name) for name in _IMAGING},
            "length": settings.length,
        }
        path = folder / f"{site}-{direction}-{key_of(content)}.bundle"
        if not path.is_file():
            count = len(simulator.reported_pose())
            stops = track(range(count), f"{site} {direction}", count)
            write_arrays(path, {"image": lane_images(settings, simulator, sensor, grid, stops)})
        objects = simulator.objects
        one = Pass(
            site=site,
            direction=direction,
            image=read_arrays(path)["image"],
            grid=grid,
            truth=simulator.truth.reset_index(drop=True),
            fiducials=objects[objects["kind"] == "fiducial"].reset_index(drop=True),
            key=path.stem,
        )
        passes.append(one)
    return passes


def study_sensor(settings: Settings) -> Sensor:
    """Return the radar of the study: the preset with the study's tones.

    Raises
    ------
    ValueError
        If echoes from outside the images appear in them with these tones.
    """
    start, step, count = settings.tones
    tones = Tones(start=start, step=step, count=int(count))
    changes = {"tones": tones, "footprint": settings.footprint}
    sensor = load_sensor(settings.sensor).model_copy(update=changes)
    x_min, x_max = settings.lane
    half = settings.step / 2 + _BEYOND
    x_span = x_min - settings.margin - _SIDE, x_max + settings.margin + _SIDE
    check_tones(sensor, x_span, (settings.ranges[0] - half, settings.ranges[-1] + half))
    return sensor


def fiducials(settings: Settings) -> list[Span]:
    """Return x and y of the fiducials on both sides of a lane, m."""
    places = []
    for y in np.arange(settings.fiducial_pitch / 2, settings.length, settings.fiducial_pitch):
        places += [(x, float(y)) for x in (-settings.fiducial_x, settings.fiducial_x)]
    return places


def _scene(settings: Settings, site: str) -> Scene:
    """Return the scene of a site's lane, with fiducials on both of its sides."""
    draws = []
    for mines in settings.mines:
        for kind, count in (("metal", mines.metal), ("plastic", mines.plastic)):
            draw = {"kind": kind, "depth": mines.depth, "count": count, "position_jitter": 0.2}
            draws.append(draw)
    reflectors = []
    for x, y in fiducials(settings):
        place = {"kind": "fiducial", "x": x, "y": y, "height": 0.3}
        reflectors.append({**place, "rcs_db": settings.fiducial_rcs})
    first = -settings.ranges[-1] - settings.step
    last = settings.length - settings.ranges[0] + settings.step
    stops = np.arange(first, last + 0.1, settings.step)
    return Scene.model_validate(
        {
            "name": site,
            "site": settings.scenes[site],
            "x_min": settings.lane[0],
            "x_max": settings.lane[1],
            "length": settings.length,
            "draws": draws,
            "objects": reflectors,
            "track": {"positions": stops.tolist()},
            "surface": {"density": settings.density},
        }
    )


def lane_images(
    settings: Settings, simulator: Simulator, sensor: Sensor, grid: Grid, stops: Iterable[int]
) -> ComplexArray:
    """Image every stop and join one lane image per polarization and range.

    The self-signature is subtracted. A pixel of the image of range d comes from the stop that sees
    it within half a step of d. The phase of the middle of the band is taken out, so that
    neighbouring pixels differ little and signatures at any distance are alike.

    Parameters
    ----------
    settings : Settings
        The study.
    simulator : Simulator
        The lane of a drive.
    sensor : Sensor
        The radar.
    grid : Grid
        Pixels of the lane image.
    stops : iterable of int
        Numbers of the stops.

    Returns
    -------
    (polarization, range, y, x) ndarray
        The lane images, 0 where no stop sees a pixel.
    """
    view = _stop_grid(settings, grid)
    pose = simulator.reported_pose()
    tx, rx = (vehicle_to_scan(positions, pose[0]) for positions in sensor.pairs())
    operator = ImagingOperator(simulator.frequency, tx, rx, view.points(), window=settings.window)
    images = [operator.adjoint(simulator.scan(stop))[:, 0] for stop in stops]
    signature = self_signature(images, "median")
    wavenumber = 2 * np.pi * float(np.mean(simulator.frequency)) / SPEED_OF_LIGHT
    path = 2 * np.linalg.norm(view.points() - (tx + rx).mean(axis=0) / 2, axis=-1)
    carrier = np.exp(-1j * wavenumber * path).astype(np.complex64)
    lane = np.zeros((images[0].shape[0], len(settings.ranges), *grid.shape), np.complex64)
    points = grid.points()
    for image, stop_pose in zip(images, pose, strict=True):
        clean = ((image / scan_gain(image) - signature) * carrier).astype(np.complex64)
        position = lane_to_scan(points, stop_pose)
        for k, distance in enumerate(settings.ranges):
            rows = np.abs(position[:, 0, 1] - distance) <= settings.step / 2
            if rows.any():
                row = (position[rows][..., 1] - view.y_min) / view.dy
                column = (position[rows][..., 0] - view.x_min) / view.dx
                lane[:, k, rows] = np.nan_to_num(bilinear(clean, row, column))
    return lane


def _stop_grid(settings: Settings, grid: Grid) -> Grid:
    """Return the pixels of a stop's image: all ranges and a border around the lane."""
    half = settings.step / 2 + _BEYOND
    nx = round((grid.x[-1] - grid.x[0] + 2 * _SIDE) / grid.dx) + 1
    ny = round((settings.ranges[-1] - settings.ranges[0] + 2 * half) * FINER / grid.dy) + 1
    x_min = float(grid.x[0]) - _SIDE
    return Grid(x_min, settings.ranges[0] - half, nx, ny, grid.dx, grid.dy / FINER)
