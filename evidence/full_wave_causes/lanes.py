"""The packaged full-wave lane, its twins, and the training lanes of its proving ground."""

from __future__ import annotations

from typing import NamedTuple

import pandas as pd
import xarray as xr

from flgpr.model import Lane, load_sensor
from flgpr.proving_ground import load_ground
from flgpr.simulate import Scene, Simulator
from flgpr.store import open_run, read_table, sample_lane
from validate_fullwave import lane_scene

LANE = Lane(-1.0, 1.0, 2.0, 6.2)
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


def twin(scene: Scene, seed: int) -> LaneData:
    """Return a twin of the packaged lane."""
    simulator = Simulator(scene, load_sensor("full-wave"), seed)
    real = full_wave()
    blocked = real.blocked
    if not scene.targets:
        blocked = blocked.iloc[len(real.targets) :]
    return LaneData(simulator.run(), LANE, real.targets, blocked)


def known_lanes(count: int) -> list[LaneData]:
    """Return the first training lanes of the full-wave proving ground."""
    lanes = []
    for lane in load_ground(False, "full-wave-1").lanes.values():
        if lane.part == "train" and len(lanes) < count:
            run = Simulator(lane.scene, lane.sensor, lane.seed).run()
            truth = lane.truth()
            lanes.append(LaneData(run, lane.lane, truth, truth[["x", "y"]]))
    return lanes
