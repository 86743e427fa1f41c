"""The suppression on the packaged full-wave lane: one band, three frames.

The thresholds come from simulated lanes of its kind. The full-wave data have a scale of their own,
so thresholds are learnt and used in units of each image's median magnitude in each sub-region.
Nothing else passes from one to the other, and the full-wave lane's truth is used only to measure
what becomes of each object.
"""

from __future__ import annotations

import tomllib
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

from flgpr.clutter import (
    FrameStack,
    ThresholdCalibration,
    Thresholds,
    averaged,
    averaged_frames,
    iterate_frames,
    iterate_suppression,
    mixed_mask,
    subregions,
    suppress_by_model,
)
from flgpr.imaging import ImagingOperator
from flgpr.kernels.windows import hann
from flgpr.model import Grid, Lane, Sensor, check_tones, vehicle_to_lane
from flgpr.screen import prescreen
from flgpr.simulate import Scene, Simulator
from flgpr.store import open_run, read_table, sample_lane
from flgpr_papers.kit.settings import packaged_text

HALF_WIDTH = 1.4
"""Half width of the imaged ground, m."""
ROADSIDES = {
    "scaled with the image": (0.4 * HALF_WIDTH, HALF_WIDTH),
    "beside the lane": (1.0, HALF_WIDTH),
}
"""Rules of where the roadside lies: nearest and farthest distance from the middle, m.

The lane of this run is 1 m to either side of the middle. The paper's roadside begins at 4 of 10 m.
"""
LANE = Lane(-1.0, 1.0, 2.0, 6.2)
# from 1.2 m ahead of the last frame's array on
_GRID = Grid.spanning((-HALF_WIDTH, HALF_WIDTH), (2.56, 6.2), 0.025)
_EDGES = np.linspace(2.56, 6.2, 5)
# m, as for this lane elsewhere
_HALO = 0.5
_RADIUS = 0.375
_DECLARED = tomllib.loads(packaged_text("fuse2018", "fullwave"))
_POLARIZATIONS = ("VV", "HH", "VH")
_REACH = 0.4  # m about a body within which its response is measured
Body = tuple[str, float, float]
"""Name of a mine or object, and its position x and y, m."""


@dataclass(frozen=True)
class FullwaveStudy:
    """What becomes of the lane."""

    #: one row per roadside rule, method and object: change of the peak in HH and VV (dB), share of
    #: the response masked, rank among the alarms in VV and false alarms above
    table: pd.DataFrame
    false: pd.DataFrame  #: one row per roadside rule and method: false alarms in the lane
    images: dict[str, NDArray[Any]]  #: magnitudes and masks for the figure
    worlds: int  #: number of calibration lanes


def fullwave_study(quick: bool = False) -> FullwaveStudy:
    """Clean the packaged full-wave lane by every method and roadside rule.

    The thresholds come from simulated lanes with the same array and soil, in which the same kinds
    of bodies lie at other positions.

    Parameters
    ----------
    quick : bool
        Few calibration lanes.
    """
    folder = sample_lane()
    run = open_run(folder / "run.zarr")
    worlds = 6 if quick else 24
    limits = _calibrate(run, worlds)
    frames = _Frames(run)
    truth = read_table(folder / "truth.csv", "truth")
    bodies = _bodies(truth, read_table(folder / "objects.csv", "objects"))
    rows: list[dict[str, Any]] = []
    false_rows: list[dict[str, Any]] = []
    images: dict[str, NDArray[Any]] = {}
    for rule, side in ROADSIDES.items():
        mask = frames.mask(limits[rule], side)
        for method, image in frames.clean(mask).items():
            about = {"roadside": rule, "method": method}
            alarms = _alarms(image[0], truth)
            false_alarms = {
                "false alarms": int((alarms["label"] == 0).sum()),
                "masked": float(mask.mean()),
            }
            false_rows.append(about | false_alarms)
            for body in bodies:
                rows.append(about | _fate(body, frames.images, image, mask, alarms))
            images[f"{rule}/{method}"] = np.abs(image[0])
        images[f"{rule}/mask"] = mask
    images["VV"] = np.abs(frames.images[0])
    images["x"] = _GRID.x
    images["y"] = _GRID.y
    images["places"] = np.array([(x, y) for _, x, y in bodies], dtype=np.float64)
    return FullwaveStudy(pd.DataFrame(rows), pd.DataFrame(false_rows), images, worlds)


def _bodies(truth: pd.DataFrame, objects: pd.DataFrame) -> list[Body]:
    """Return the mines and objects of the lane."""
    bodies: list[Body] = []
    for kind, depth, x, y in truth[["kind", "depth", "x", "y"]].values:
        bodies.append((f"{kind} mine, {100 * depth:g} cm", x, y))
    for kind, x, y in objects[["kind", "x", "y"]].to_numpy():
        bodies.append((kind, x, y))
    return bodies


class _Frames:
    """Frames of a run of this lane's array, imaged together."""

    def __init__(self, run: xr.Dataset) -> None:
        f = np.asarray(run["frequency"].values, dtype=np.float64)
        # The direct coupling outshines every echo. A taper keeps its sidelobes out; half of it goes
        # to the data and half to A, so that A and A^H stay each other's transposes.
        taper = np.sqrt(hann(2 * (f - f.mean()) / np.ptp(f)))
        signal = run["signal"].sel(polarization=list(_POLARIZATIONS)).values
        self.data = np.asarray(signal * taper, dtype=np.complex64)
        self.operators = [_operator_on(run, f, taper, pose) for pose in run["pose"].values]
        self.pixels = _GRID.points()
        self.region = subregions(self.pixels[..., 1], _EDGES)
        self.images = self._stack(self.pixels).adjoint(self.data)[:, 0]

    def over_median(self, polarization: int) -> NDArray[np.complex64]:
        """Return an image over the median magnitude of every pixel's sub-region."""
        image = self.images[polarization]
        numbers = range(self.region.max() + 1)
        medians = [np.median(np.abs(image[self.region == number])) for number in numbers]
        return np.asarray(image / np.array(medians)[self.region])

    def _stack(self, points: NDArray[np.float64]) -> FrameStack:
        """Return the frames' operators on points as one."""
        return FrameStack([operator_on(points) for operator_on in self.operators])

    def mask(self, limits: Thresholds, side: tuple[float, float]) -> NDArray[np.bool_]:
        """Return the mixed mask (y, x) of VV and VH by thresholds in units of the medians.

        Parameters
        ----------
        limits : Thresholds
            The thresholds.
        side : tuple of float
            Nearest and farthest distance of the roadside from the middle, m.
        """
        vv = self.over_median(0)
        vh = self.over_median(2)
        return mixed_mask(vv, vh, limits, self.region, self.pixels[..., 0], roadside=side)

    def clean(self, mask: NDArray[np.bool_]) -> dict[str, NDArray[np.complex64]]:
        """Clean VV and HH under a mask (y, x), and image them (polarization, y, x) by method."""
        data = self.data[:, :2]
        shared = iterate_suppression(data, self._stack, self.pixels, mask, self.region)
        iterated = iterate_frames(data, self.operators, self.pixels, mask, self.region)
        fitted = data
        if mask.any():
            fitted = suppress_by_model(data, self._stack(self.pixels[mask]), 20).data
        cleaned = {
            "none": data,
            "iteration": averaged(shared, 6),
            "per frame": averaged_frames(iterated, 6),
            "least squares": fitted,
        }
        stack = self._stack(self.pixels)
        return {method: stack.adjoint(values)[:, 0] for method, values in cleaned.items()}


def _operator_on(
    run: xr.Dataset,
    frequency: NDArray[np.float64],
    taper: NDArray[np.float64],
    pose: NDArray[np.float64],
) -> Callable[[NDArray[np.float64]], ImagingOperator]:
    """Return the imaging operator of a run's antennas, for given points."""
    tx = vehicle_to_lane(run["tx_position"].values, pose)
    rx = vehicle_to_lane(run["rx_position"].values, pose)

    def operator_on(points: NDArray[np.float64]) -> ImagingOperator:
        return ImagingOperator(frequency, tx, rx, points, window=taper)

    return operator_on


def _calibrate(run: xr.Dataset, worlds: int) -> dict[str, Thresholds]:
    """Learn the thresholds of every roadside rule on simulated lanes."""
    calibrations = {name: ThresholdCalibration(len(_EDGES) - 1) for name in ROADSIDES}
    sensor = _sensor(run)
    across = np.abs(_GRID.points()[..., 0])
    for seed in range(worlds):
        simulator = Simulator(_scene(run, seed), sensor, seed)
        frames = _Frames(simulator.run())
        x = frames.pixels[..., 0]
        y = frames.pixels[..., 1]
        halos = []
        for target in simulator.world.targets:
            halos.append(np.hypot(x - target.x, y - target.y) <= _REACH)
        vv = frames.over_median(0)
        vh = frames.over_median(2)
        for name, (nearest, farthest) in ROADSIDES.items():
            is_roadside = (across >= nearest) & (across <= farthest)
            calibrations[name].add(vv, vh, frames.region, halos, is_roadside)
    return {name: calibration.result() for name, calibration in calibrations.items()}


def _sensor(run: xr.Dataset) -> Sensor:
    """Return the sensor of a full-wave run."""
    f = run["frequency"].values
    sensor = Sensor.model_validate(
        {
            **_DECLARED["sensor"],
            "tones": {"start": f[0], "step": f[1] - f[0], "count": f.size},
            "polarization": tuple(run["polarization"].values.tolist()),
            "tx": np.unique(run["tx_position"].values, axis=0).tolist(),
            "rx": np.unique(run["rx_position"].values, axis=0).tolist(),
            "height": float(run["pose"].values[0, 2]),
        }
    )
    check_tones(sensor, (-HALF_WIDTH, HALF_WIDTH), (float(_GRID.y[0]), float(_GRID.y[-1])))
    return sensor


def _scene(run: xr.Dataset, seed: int) -> Scene:
    """Draw a calibration lane.

    It has two metal and two plastic mines along it, a rock in it and a post beside it.
    """
    rng = np.random.default_rng([2018, seed])
    order = rng.permutation(["metal", "metal", "plastic", "plastic"]).tolist()
    targets = []
    for kind, y in zip(order, (3.0, 3.9, 4.8, 5.7), strict=True):
        place = {"x": rng.uniform(-0.6, 0.6), "y": y + rng.uniform(-0.2, 0.2)}
        depth = rng.uniform(0.015, 0.06)
        targets.append({"kind": kind, **place, "depth": depth, **_DECLARED["mine"]})
    rock = {"x": rng.uniform(-0.8, 0.8), "y": rng.uniform(2.6, 6.0)}
    post = {"x": rng.choice([-1.2, 1.2]), "y": rng.uniform(2.8, 6.0)}
    scene = _DECLARED["scene"]
    soil = {name: run.attrs["soil"][name] for name in ("permittivity", "conductivity")}
    return Scene.model_validate(
        {
            **scene,
            "name": f"calibration {seed}",
            "soil": {"model": "fixed", **soil},
            "surface": {**scene["surface"], "texture_shape": None},
            "targets": targets,
            "objects": [_DECLARED["rock"] | rock, _DECLARED["post"] | post],
            "track": {"positions": tuple(run["pose"].values[:, 1].tolist())},
        }
    )


def _alarms(image: NDArray[np.complex64], truth: pd.DataFrame) -> pd.DataFrame:
    """Return the alarms of a VV image in the lane, strongest first.

    ``label`` is the number of the mine that an alarm hits, from 1, or 0 for none.
    """
    view = xr.DataArray(
        np.abs(image).astype(np.float64), dims=("y", "x"), coords={"y": _GRID.y, "x": _GRID.x}
    )
    alarms = prescreen(view, LANE, _RADIUS)
    alarms = alarms[LANE.contains(alarms["x"], alarms["y"])].reset_index(drop=True)
    across = alarms[["x"]].to_numpy() - truth["x"].to_numpy()
    along = alarms[["y"]].to_numpy() - truth["y"].to_numpy()
    distance = np.hypot(across, along)
    is_hit = distance.min(axis=1) <= _HALO
    return alarms.assign(label=np.where(is_hit, distance.argmin(axis=1) + 1, 0))


def _fate(
    body: Body,
    before: NDArray[np.complex64],
    after: NDArray[np.complex64],
    mask: NDArray[np.bool_],
    alarms: pd.DataFrame,
) -> dict[str, Any]:
    """Return what becomes of a body's peak, and the share of its response that is masked."""
    name, x, y = body
    points = _GRID.points()
    is_near = np.hypot(points[..., 0] - x, points[..., 1] - y) <= _REACH
    changes = {}
    for number, polarization in enumerate(("VV", "HH")):
        peak_after = np.abs(after[number][is_near]).max()
        peak_before = np.abs(before[number][is_near]).max()
        changes[polarization] = 20 * np.log10(peak_after / peak_before)
    magnitude = np.where(is_near, np.abs(before[0]), 0)
    response = magnitude >= magnitude.max() / 2
    hits = np.flatnonzero(np.hypot(alarms["x"] - x, alarms["y"] - y) <= _HALO)
    rank = 0
    false_above = -1
    if hits.size and "mine" in name:
        rank = int(hits[0]) + 1
        false_above = int((alarms["label"].to_numpy()[: rank - 1] == 0).sum())
    return {
        "object": name,
        **changes,
        "masked": float(mask[response].mean()),
        "rank": rank,
        "above": false_above,
    }
