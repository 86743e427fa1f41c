"""Full-wave lanes, their twins, plain or with the ground's echo, and training lanes."""

from __future__ import annotations

from typing import NamedTuple

import pandas as pd
import xarray as xr

from flgpr.model import Lane, Sensor, load_sensor
from flgpr.proving_ground import load_ground
from flgpr.simulate import Scene, Simulator
from flgpr.store import open_run, read_table, sample_lane
from full_wave_2 import declared, scene_of
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
WITH_OWN_ECHOES = OWN + ", with the full-wave lane's early echoes"


class LaneData(NamedTuple):
    """A run in memory with what lies in it."""

    run: xr.Dataset
    lane: Lane
    targets: pd.DataFrame  # the mines
    blocked: pd.DataFrame  # where no clutter is learnt: mines, and objects of the lane


def full_wave() -> LaneData:
    """Return the packaged lane."""
    folder = sample_lane()
    run = open_run(folder / "run.zarr")
    truth = read_table(folder / "truth.csv", "truth")
    objects = read_table(folder / "objects.csv", "objects")
    blocked = pd.concat([truth[["x", "y"]], objects[["x", "y"]]], ignore_index=True)
    return LaneData(run, LANE, truth, blocked)


def twin_scene(surface: tuple[float, float], targets: bool = True) -> Scene:
    """Return the scene of the packaged lane, over a surface, with its targets or without."""
    real = full_wave()
    objects = read_table(sample_lane() / "objects.csv", "objects")
    scene = lane_scene(real.run, real.targets, objects)
    rms, length = surface
    rough = scene.surface.model_copy(update={"rms_height": rms, "correlation_length": length})
    changes = {"surface": rough}
    if not targets:
        changes["targets"] = ()
    return scene.model_copy(update=changes)


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
    folder = sample_lane(f"full-wave-2-{number}")
    run = open_run(folder / "run.zarr")
    truth = read_table(folder / "truth.csv", "truth")
    objects = read_table(folder / "objects.csv", "objects")
    blocked = pd.concat([truth[["x", "y"]], objects[["x", "y"]]], ignore_index=True)
    return LaneData(run, SOLVED_LANE, truth, blocked)


def solved_scene(number: int, targets: bool = True) -> Scene:
    """Return the declared scene of a solved lane; its buried stones are left out.

    The ground scatters as its heights do: without larger tilts and without a texture of its own.
    """
    common = declared()
    scene = scene_of(common, common["lanes"][number - 1])
    surface = scene.surface.model_copy(update={"slope": 0.0, "texture_shape": None})
    changes = {"surface": surface}
    if not targets:
        changes["targets"] = ()
    return scene.model_copy(update=changes)


def solved_twin(number: int, seed: int, echo: bool = False, targets: bool = True) -> LaneData:
    """Return a twin of a solved lane over a surface of its own, plain or with the ground's echo."""
    sensor = load_sensor(ECHO if echo else PLAIN)
    sensor = sensor.model_copy(update={"polarization": ("HH", "HV")})
    run = Simulator(solved_scene(number, targets), sensor, seed).run()
    real = solved_lane(number)
    return LaneData(run, SOLVED_LANE, real.targets, real.blocked)


def known_lanes(count: int, ground: str = "full-wave-1", echo: bool = False) -> list[LaneData]:
    """Return the first training lanes of a full-wave track, plain or with the ground's echo."""
    lanes = []
    for lane in load_ground(False, ground).lanes.values():
        if lane.part == "train" and len(lanes) < count:
            sensor = with_echo(lane.sensor) if echo else lane.sensor
            run = Simulator(lane.scene, sensor, lane.seed).run()
            truth = lane.truth()
            lanes.append(LaneData(run, lane.lane, truth, truth[["x", "y"]]))
    return lanes
