"""Full-wave lanes and their twins, plain or with the ground's echo, their images in chips, and their scale."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
import xarray as xr

from flgpr.imaging import ScanImager
from flgpr.model import SPEED_OF_LIGHT, Grid, Lane, Sensor, lane_to_scan, load_sensor
from flgpr.simulate import Scene, Simulator
from flgpr.store import SAMPLE_LANES, open_run, read_table, sample_lane
from full_wave_lanes import declared, scene_of
from validate_fullwave import lane_scene

LANE = Lane(-1.0, 1.0, 2.0, 6.2)
SOLVED_LANE = Lane(-1.0, 1.0, 0.0, 4.2)
SOLVED = (1, 2, 3, 4, 5, 6)  # lanes of full-wave-2
PLAIN = "full-wave"
ECHO = "full-wave-echo"
SURFACES = {  # rms height and correlation length, m
    "rms 1.5 mm": (0.0015, 0.10),
    "rms 3 mm": (0.003, 0.10),
    "rms 6 mm, the lane's": (0.006, 0.10),
    "rms 9 mm": (0.009, 0.10),
    "rms 6 mm, correlated over 5 cm": (0.006, 0.05),
}
OWN = "rms 6 mm, the lane's"
BANDS = {
    "B0": (0.45e9, 0.60e9),
    "B1": (0.60e9, 0.80e9),
    "B2": (0.80e9, 1.05e9),
    "F0": (0.45e9, 1.5e9),
}
CHIP_BANDS = 3  # the first three are those of `fused`; the last is that of C_HH
CHIP = np.stack([*np.meshgrid([-0.2, 0.0, 0.2], [-0.2, 0.0, 0.2]), np.zeros((3, 3))], axis=-1)
CHIP = CHIP.reshape(-1, 3)


class LaneData(NamedTuple):
    """A run in memory with what lies in it."""

    run: xr.Dataset
    lane: Lane
    targets: pd.DataFrame  # the mines
    blocked: pd.DataFrame  # where no clutter is learnt: mines, and objects of the lane


def full_wave(name: str = SAMPLE_LANES[0], borders: Lane = LANE) -> LaneData:
    """Return a packaged lane, by default the first."""
    folder = sample_lane(name)
    run = open_run(folder / "run.zarr")
    truth = read_table(folder / "truth.csv", "truth")
    objects = read_table(folder / "objects.csv", "objects")
    blocked = pd.concat([truth[["x", "y"]], objects[["x", "y"]]], ignore_index=True)
    return LaneData(run, borders, truth, blocked)


def twin_scene(surface: tuple[float, float], targets: bool = True) -> Scene:
    """Return the scene of the packaged lane, over a surface, with its targets or without."""
    real = full_wave()
    objects = read_table(sample_lane() / "objects.csv", "objects")
    scene = lane_scene(real.run, real.targets, objects)
    rms, length = surface
    rough = scene.surface.model_copy(update={"rms_height": rms, "correlation_length": length})
    return scene.model_copy(update={"surface": rough} | ({} if targets else {"targets": ()}))


def twin(scene: Scene, seed: int, sensor: Sensor | None = None) -> LaneData:
    """Return a twin of the packaged lane, plain unless a sensor is given."""
    simulator = Simulator(scene, sensor or load_sensor(PLAIN), seed)
    real = full_wave()
    blocked = real.blocked
    if not scene.targets:
        blocked = blocked.iloc[len(real.targets) :]
    return LaneData(simulator.run(), LANE, real.targets, blocked)


def with_echo(sensor: Sensor) -> Sensor:
    """Return a sensor of the full-wave tracks with the ground below it and its specular echo."""
    echo = load_sensor(ECHO)
    names = ("footprint", "specular_echo", "direct_wave")
    return sensor.model_copy(update={name: getattr(echo, name) for name in names})


def solved_lane(number: int) -> LaneData:
    """Return a solved lane of full-wave-2, by its number from 1 on."""
    return full_wave(f"full-wave-2-{number}", SOLVED_LANE)


def solved_scene(number: int, targets: bool = True) -> Scene:
    """Return the declared scene of a solved lane; its buried stones are left out.

    The ground scatters as its heights do: without larger tilts and without a texture of its own.
    """
    common = declared(Path(__file__).parent / "full_wave_2.toml")
    scene = scene_of(common, common["lanes"][number - 1])
    surface = scene.surface.model_copy(update={"slope": 0.0, "texture_shape": None})
    return scene.model_copy(update={"surface": surface} | ({} if targets else {"targets": ()}))


def solved_twin(number: int, seed: int, echo: bool = False, targets: bool = True) -> LaneData:
    """Return a twin of a solved lane over a surface of its own, plain or with the ground's echo."""
    sensor = load_sensor(ECHO if echo else PLAIN)
    sensor = sensor.model_copy(update={"polarization": ("HH", "HV")})
    run = Simulator(solved_scene(number, targets), sensor, seed).run()
    real = solved_lane(number)
    return LaneData(run, SOLVED_LANE, real.targets, real.blocked)


def scale_of(run: xr.Dataset) -> tuple[float, float]:
    """Return the data's scale, and its standard deviation over pairs (dB), by the direct wave.

    The field of a short vertical dipole at another beside it is known (near field included). Data
    and closed form are compared at the delay of the direct wave, under a Hann window, in VV. Pairs
    nearer than 0.4 m are left out, which the solver's cells do not resolve, and pairs farther than
    1.5 m, near whose delay the ground's echo lies.
    """
    frequency = run["frequency"].values
    tx = run["tx_position"].values
    rx = run["rx_position"].values
    signal = run["signal"].sel(polarization="VV").values
    window = np.hanning(frequency.size)
    k = 2 * np.pi * frequency / SPEED_OF_LIGHT
    ratios = []
    for pair in range(len(tx)):
        off = rx[pair] - tx[pair]
        r = np.linalg.norm(off)
        if not 0.4 < r < 1.5:
            continue
        cosine = off[2] / r
        along = 2 * cosine**2 * (1 / (1j * k * r) + 1 / (1j * k * r) ** 2)
        across = (1 - cosine**2) * (1 + 1 / (1j * k * r) + 1 / (1j * k * r) ** 2)
        # j times the field over the current moment; the free-space impedance is 376.7 ohm.
        field = 376.73 * k / (4 * np.pi * r) * (across - along)
        closed = (window * field).sum()
        focused = (window * signal[:, pair] * np.exp(1j * k * r)).sum(axis=-1)
        ratios.append(np.abs(focused) / np.abs(closed))
    decibel = 20 * np.log10(np.array(ratios))
    return float(10 ** (np.median(decibel) / 20)), float(decibel.std())


def chips_at(run: xr.Dataset, scan: int, places: np.ndarray, signal=None) -> np.ndarray:
    """Return chips (place, polarization, band, pixel) of a scan's image at places of the lane."""
    imager = ScanImager(run, Grid.spanning((-1.4, 1.4), (1.2, 5.84), 0.1), BANDS, "hann", 1e-4)
    points = lane_to_scan(
        np.column_stack([places, np.zeros(len(places))]), run["pose"].values[scan]
    )
    operator = imager.operator_on(scan, (points[:, None] + CHIP).reshape(-1, 3), imager.subbands)
    image = operator.adjoint(imager.signal(scan) if signal is None else signal)
    chips = image.reshape(*image.shape[:2], len(places), len(CHIP))
    return np.moveaxis(chips, 2, 0)
