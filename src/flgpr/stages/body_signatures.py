"""Signatures of simulated bodies, alone in the ground, as chips of scan images."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from flgpr.imaging import ScanImager
from flgpr.model import Grid, Sensor, lane_to_scan, load_sensor
from flgpr.model.run_sensor import sensor_of_run
from flgpr.simulate import ALONE, BARE, Scene, Simulator
from flgpr.stages import Setup
from flgpr.types import ComplexArray, Entries, FloatArray

OWN_ARRAY = "run"
"""Name of the sensor that is the array of the run itself."""
_APART = 100.0  # m between simulated bodies: a scan sees no farther
_TILT = math.radians(4)  # rms in each axis, as mines are laid
_SEED = 2026
_SAME_PLACE = 0.01  # m, by which antennas lie apart at most where they are the same
_STONES = (0.04, 0.12)  # m, radii of stones: smaller ones are seldom seen


class Bodies(NamedTuple):
    """Which bodies are simulated, and where."""

    kinds: tuple[str, ...]  #: kinds of mines; without any, stones that lie half in the ground
    depths: tuple[float, ...]  #: depths of their tops, m
    soils: tuple[tuple[float, float], ...]  #: permittivity and loss tangent
    copies: int  #: of every kind and depth in every soil
    step: float  #: m between the pixels of a chip


class Imaging(NamedTuple):
    """How chips of simulated bodies are imaged."""

    grid: Grid  #: pixels of the images
    subbands: tuple[tuple[str, tuple[float, float]], ...]
    polarizations: tuple[str, ...]
    window: str | tuple[float, ...] | None
    tolerance: float
    pixels: tuple[tuple[float, float], ...]  #: pixels of a chip about its place, m
    limits: tuple[float, float]  #: limits across, m
    tones: tuple[float, ...]  #: tones of the run, Hz, among those of the sensor


class _Spot(NamedTuple):
    """Where a body lies and how it leans."""

    x: float  # m, lane frame
    y: float
    kind: str
    depth: float
    lean: tuple[float, float]  # rad in each axis
    stone_radius: float  # m


@lru_cache(maxsize=4)
def signatures(bodies: Bodies, sensor: Sensor, imaging: Imaging) -> tuple[ComplexArray, FloatArray]:
    """Simulate bodies alone and cut their chips out of images.

    Parameters
    ----------
    bodies : Bodies
        Which bodies.
    sensor : Sensor
        What sees them.
    imaging : Imaging
        How they are imaged.

    Returns
    -------
    chips : (body, polarization, subband, pixel) ndarray of complex
        The chips.
    positions : (body, 2) ndarray
        x and y of their middles in the scan frame, m.
    """
    chips = []
    positions = []
    for number, soil in enumerate(bodies.soils):
        rng = np.random.default_rng([_SEED, number])
        spots = _draw_spots(bodies, imaging, rng)
        run, poses = _simulate(bodies, soil, spots, imaging, sensor, number)
        run = run.sel(frequency=list(imaging.tones), method="nearest")
        imager = ScanImager(
            run.sel(polarization=list(imaging.polarizations)),
            imaging.grid,
            dict(imaging.subbands),
            imaging.window,
            imaging.tolerance,
        )
        for scan, spot in enumerate(spots):
            position = lane_to_scan(np.array([spot.x, spot.y, 0.0]), poses[scan])
            # No mine lies on a pixel.
            position[:2] += rng.uniform(-bodies.step / 4, bodies.step / 4, 2)
            offsets = np.column_stack([imaging.pixels, np.zeros(len(imaging.pixels))])
            operator = imager.operator_on(scan, position + offsets, imager.subbands)
            chips.append(operator.adjoint(imager.signal(scan)))
            positions.append(position[:2])
    return np.stack(chips), np.array(positions)


def _draw_spots(bodies: Bodies, imaging: Imaging, rng: np.random.Generator) -> list[_Spot]:
    """Draw the places of the bodies in one soil, each alone in the image of its scan."""
    sorts = [(kind, depth) for kind in bodies.kinds for depth in bodies.depths]
    if not sorts:
        sorts = [("", 0.0)]
    sorts = sorts * bodies.copies
    count = len(sorts)
    edge = 1.5 * bodies.step
    _, _, nearest, farthest = imaging.grid.extent()
    left, right = imaging.limits
    ahead = rng.permutation(np.linspace(nearest + edge, farthest - edge, count))
    across = rng.uniform(left + edge, right - edge, count)
    lean = rng.normal(0, _TILT, (count, 2))
    radius = np.linspace(*_STONES, count)
    spots = []
    for number, (kind, depth) in enumerate(sorts):
        spots.append(
            _Spot(
                x=float(across[number]),
                y=float(_APART * number + ahead[number]),
                kind=kind,
                depth=depth,
                lean=(lean[number, 0], lean[number, 1]),
                stone_radius=float(radius[number]),
            )
        )
    return spots


def _simulate(
    bodies: Bodies,
    soil: tuple[float, float],
    spots: list[_Spot],
    imaging: Imaging,
    sensor: Sensor,
    seed: int,
) -> tuple[Any, FloatArray]:
    """Return a run with a scan before every body, and the poses of its scans."""
    ground = _ground(soil, len(spots), imaging.limits)
    targets = [_target(spot) for spot in spots] if bodies.kinds else []
    # What does not come from the bodies would only be added and taken off again.
    sensor = sensor.model_copy(update={"direct_wave": False, "specular_echo": False})
    simulator = Simulator(Scene.model_validate(ground | {"targets": targets}), sensor, seed)
    run = simulator.run(bodies=True)
    if not bodies.kinds:
        # A stone is what the scan with it has more than the one without.
        stones = [
            {"kind": "rock", "x": spot.x, "y": spot.y, "radius": spot.stone_radius}
            for spot in spots
        ]
        with_stones = Simulator(Scene.model_validate(ground | {"objects": stones}), sensor, seed)
        run["signal"] = with_stones.run()["signal"] - simulator.run()["signal"]
    return run, simulator.pose


def _ground(soil: tuple[float, float], count: int, limits: tuple[float, float]) -> Entries:
    """Return the scene of bare ground with a scan for each of so many bodies."""
    permittivity, loss_tangent = soil
    return {
        "soil": {"model": "fixed", "permittivity": permittivity, "loss_tangent": loss_tangent},
        "length": _APART * count,
        "x_min": limits[0],
        "x_max": limits[1],
        "clutter": BARE,
        "track": {"positions": [_APART * number for number in range(count)]},
        **ALONE,
    }


def _target(spot: _Spot) -> Entries:
    """Return the entries of a mine in a scene."""
    lean_x, lean_y = spot.lean
    return {
        "kind": spot.kind,
        "depth": spot.depth,
        "x": spot.x,
        "y": spot.y,
        "tilt": math.hypot(lean_x, lean_y),
        "azimuth": math.atan2(lean_y, lean_x),
    }


def sensor_of(setup: Setup, name: str, antennas: str = "") -> Sensor:
    """Return the sensor of signatures, without missing sweeps and errors of navigation.

    Parameters
    ----------
    setup : Setup
        The chain of the stage.
    name : str
        A packaged sensor, or a file; "run" is the array of the run itself, see
        :func:`flgpr.model.run_sensor.sensor_of_run`.
    antennas : str
        With "run" the packaged sensor, or the file, whose antennas' pattern and tilt, and whose
        errors are assumed.

    Raises
    ------
    ValueError
        If it is not the array of the run.
    """
    if name == OWN_ARRAY:
        sensor = sensor_of_run(setup.run, load_sensor(antennas))
    else:
        sensor = load_sensor(name)
        _check_array(setup, sensor, name)
    no_errors = dict.fromkeys(("missing", "position", "heading", "attitude"), 0.0)
    return sensor.model_copy(update={"errors": sensor.errors.model_copy(update=no_errors)})


def _check_array(setup: Setup, sensor: Sensor, name: str) -> None:
    """Refuse a sensor without an antenna pair or a tone of the run, which may have lost some of its own."""
    ours = np.concatenate(sensor.pairs(), axis=1)
    theirs = np.concatenate([setup.run[f"{end}_position"].values for end in ("tx", "rx")], axis=1)
    apart = np.abs(theirs[:, None] - ours).max(axis=-1)
    strange = int((apart.min(axis=1) > _SAME_PLACE).sum())
    if strange:
        raise ValueError(
            f"map.sensor must describe the run's array, got {name!r}, which has other antennas than "
            f"{strange} of {len(theirs)} pairs"
        )
    tones = np.round(setup.run["frequency"].values)
    strange = int((~np.isin(tones, np.round(sensor.tones.axis()))).sum())
    if strange:
        raise ValueError(
            f"map.sensor must have the run's tones, got {name!r}, which lacks {strange} of {len(tones)}"
        )


def window_of(imager: ScanImager) -> str | tuple[float, ...] | None:
    """Return the window of an imager as a value that can be compared."""
    window = imager.window
    if window is None or isinstance(window, str):
        return window
    return tuple(np.asarray(window, dtype=float).tolist())
