"""The suppression on the packaged full-wave lane.

One band, three frames, thresholds from simulated lanes of its kind. The full-wave data have a scale
of their own, so thresholds are learnt and used in units of each image's median magnitude in each
sub-region. Nothing else passes from one to the other, and the full-wave lane's truth is used only
to tell what became of each object.
"""

from __future__ import annotations

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

HALF_WIDTH = 1.4
"""Of the imaged ground, m."""
ROADSIDES = {
    "scaled with the image": (0.4 * HALF_WIDTH, HALF_WIDTH),
    "beside the lane": (1.0, HALF_WIDTH),
}
"""The lane of this run is 1 m to either side of the middle.

The paper's roadside begins at 4 of 10 m.
"""
LANE = Lane(-1.0, 1.0, 2.0, 6.2)
_GRID = Grid.spanning(
    (-HALF_WIDTH, HALF_WIDTH), (2.56, 6.2), 0.025
)  # 1.2 m ahead of the last frame's array and on
_EDGES = np.linspace(2.56, 6.2, 5)
# m, as for this lane elsewhere
_HALO = 0.5
_RADIUS = 0.375
_METHODS = ("none", "iteration", "per frame", "least squares")


@dataclass(frozen=True)
class FullwaveStudy:
    """What became of the lane."""

    #: one row per roadside rule, method and object: change of the peak in HH and VV (dB), share of
    #: the response masked, rank among the alarms in VV and false alarms above
    table: pd.DataFrame
    false: pd.DataFrame  #: one row per roadside rule and method: false alarms in the lane, residual
    images: dict[str, NDArray[Any]]  #: magnitudes and masks for the figure
    thresholds: Thresholds  #: in units of the median of the sub-region
    worlds: int  #: number of calibration lanes


def fullwave_study(quick: bool = False) -> FullwaveStudy:
    """Learn thresholds on simulated lanes with the same array and soil.

    The same kinds of bodies lie at other positions.
    """
    folder = sample_lane()
    run = open_run(folder / "run.zarr")
    worlds = 6 if quick else 24
    limits = _calibrate(run, worlds)
    frames = _Frames(run, ("VV", "HH", "VH"))
    truth = read_table(folder / "truth.csv", "truth")
    objects = read_table(folder / "objects.csv", "objects")
    places = [
        (f"{kind} mine, {100 * depth:g} cm", x, y)
        for kind, depth, x, y in truth[["kind", "depth", "x", "y"]].values
    ]
    places += [(kind, x, y) for kind, x, y in objects[["kind", "x", "y"]].to_numpy()]
    rows = []
    alarms = []
    images = {}
    for rule, side in ROADSIDES.items():
        mask = frames.mask(limits[rule], side)
        cleaned, residual = frames.clean(mask)
        for method, image in cleaned.items():
            alarm_table = _alarms(image[0], truth)
            alarms.append(
                {
                    "roadside": rule,
                    "method": method,
                    "false alarms": int((alarm_table["label"] == 0).sum()),
                }
                | {"residual": residual[method], "masked": float(mask.mean())}
            )
            rows += [
                {"roadside": rule, "method": method}
                | _fate(target, frames.images, image, mask, alarm_table)
                for target in places
            ]
            images[f"{rule}/{method}"] = np.abs(image[0])
        images[f"{rule}/mask"] = mask
    images |= {
        "VV": np.abs(frames.images[0]),
        "HH": np.abs(frames.images[1]),
        "VH": np.abs(frames.images[2]),
    }
    images |= {
        "x": _GRID.x,
        "y": _GRID.y,
        "places": np.array([target[1:] for target in places], dtype=np.float64),
    }
    first = next(iter(ROADSIDES))
    return FullwaveStudy(pd.DataFrame(rows), pd.DataFrame(alarms), images, limits[first], worlds)


class _Frames:
    """Frames of a run of this lane's array, imaged together."""

    def __init__(self, run: xr.Dataset, polarizations: tuple[str, ...]) -> None:
        f = np.asarray(run["frequency"].values, dtype=np.float64)
        # The direct coupling outshines every echo. A taper keeps its sidelobes out; half of it goes
        # to the data and half to A, so that A and A^H stay each other's transposes.
        taper = np.sqrt(hann(2 * (f - f.mean()) / np.ptp(f)))
        signal = run["signal"].sel(polarization=list(polarizations)).values
        self.data = np.asarray(signal * taper, dtype=np.complex64)
        self.operators = [_operator_on(run, f, taper, pose) for pose in run["pose"].values]
        self.pixels = _GRID.points()
        self.region = subregions(self.pixels[..., 1], _EDGES)
        self.images = self._stack(self.pixels).adjoint(self.data)[:, 0]
        self.level = np.array([_medians(image, self.region) for image in self.images])

    def _stack(self, points: NDArray[np.float64]) -> FrameStack:
        """Return the frames' operators on points as one."""
        return FrameStack([make(points) for make in self.operators])

    def mask(self, limits: Thresholds, side: tuple[float, float]) -> NDArray[np.bool_]:
        """Mixed mask of VV and VH, thresholds in medians."""
        vv = self.images[0] / self.level[0]
        vh = self.images[2] / self.level[2]
        return mixed_mask(vv, vh, limits, self.region, self.pixels[..., 0], roadside=side)

    def clean(
        self, mask: NDArray[np.bool_]
    ) -> tuple[dict[str, NDArray[np.complex64]], dict[str, float]]:
        """Clean VV and HH under a mask by every method."""
        data = self.data[:, :2]
        points = self.pixels[mask]
        shared = iterate_suppression(data, self._stack, self.pixels, mask, self.region)
        iterated = iterate_frames(data, self.operators, self.pixels, mask, self.region)
        cleaned_images = {
            "none": data,
            "iteration": averaged(shared, 6),
            "per frame": averaged_frames(iterated, 6),
            "least squares": suppress_by_model(data, self._stack(points), 20).data
            if mask.any()
            else data,
        }
        stack = self._stack(self.pixels)
        norm = float(np.linalg.norm(data))
        images = {name: stack.adjoint(cleaned_images[name])[:, 0] for name in _METHODS}
        return images, {
            name: float(np.linalg.norm(cleaned_images[name])) / norm for name in _METHODS
        }


def _operator_on(
    run: xr.Dataset,
    frequency: NDArray[np.float64],
    taper: NDArray[np.float64],
    pose: NDArray[np.float64],
) -> Callable[[NDArray[np.float64]], ImagingOperator]:
    """Return the imaging operator of a run's antennas, for given points."""
    tx, rx = (vehicle_to_lane(run[name].values, pose) for name in ("tx_position", "rx_position"))
    return lambda points: ImagingOperator(frequency, tx, rx, points, window=taper)


def _medians(image: NDArray[np.complex64], region: NDArray[np.int64]) -> NDArray[np.float64]:
    """Median magnitude of every pixel's sub-region."""
    middle = np.array([np.median(np.abs(image[region == r])) for r in range(region.max() + 1)])
    return np.asarray(middle[region])


def _calibrate(run: xr.Dataset, worlds: int) -> dict[str, Thresholds]:
    """Learn thresholds on simulated lanes with the same array and soil.

    The same kinds of bodies lie at other positions.
    """
    learnt = {name: ThresholdCalibration(len(_EDGES) - 1) for name in ROADSIDES}
    sensor = _sensor(run)
    reach = 0.4
    across = np.abs(_GRID.points()[..., 0])
    for seed in range(worlds):
        simulator = Simulator(_scene(run, seed), sensor, seed)
        frames = _Frames(simulator.run(), ("VV", "HH", "VH"))
        x = frames.pixels[..., 0]
        y = frames.pixels[..., 1]
        halos = [np.hypot(x - t.x, y - t.y) <= reach for t in simulator.world.targets]
        vv = frames.images[0] / frames.level[0]
        vh = frames.images[2] / frames.level[2]
        for name, (near, far) in ROADSIDES.items():
            learnt[name].add(vv, vh, frames.region, halos, (across >= near) & (across <= far))
    return {name: sum_.result() for name, sum_ in learnt.items()}


def _sensor(run: xr.Dataset) -> Sensor:
    """Return the sensor of a full-wave run."""
    f = run["frequency"].values
    sensor = Sensor.model_validate(
        {
            "name": "full-wave array",
            "source": "packaged full-wave lane",
            "tones": {"start": f[0], "step": f[1] - f[0], "count": f.size},
            "polarization": tuple(run["polarization"].values.tolist()),
            "tx": np.unique(run["tx_position"].values, axis=0).tolist(),
            "rx": np.unique(run["rx_position"].values, axis=0).tolist(),
            "height": float(run["pose"].values[0, 2]),
            "antenna": {"kind": "dipole"},
            "footprint": (-2.0, 2.0, 0.8, 6.5),
        }
    )
    check_tones(sensor, (-HALF_WIDTH, HALF_WIDTH), (float(_GRID.y[0]), float(_GRID.y[-1])))
    return sensor


def _scene(run: xr.Dataset, seed: int) -> Scene:
    """Draw a calibration lane.

    Two metal and two plastic mines along it, a rock in it and a post beside it.
    """
    rng = np.random.default_rng([2018, seed])
    soil = run.attrs["soil"]
    order = rng.permutation(["metal", "metal", "plastic", "plastic"]).tolist()
    targets = [
        {
            "kind": kind,
            "x": rng.uniform(-0.6, 0.6),
            "y": y + rng.uniform(-0.2, 0.2),
            "depth": rng.uniform(0.015, 0.06),
        }
        | {"radius": 0.165, "height": 0.12}
        for kind, y in zip(order, (3.0, 3.9, 4.8, 5.7), strict=True)
    ]
    bodies = [
        {"kind": "rock", "x": rng.uniform(-0.8, 0.8), "y": rng.uniform(2.6, 6.0), "radius": 0.06},
        {
            "kind": "post",
            "x": rng.choice([-1.2, 1.2]),
            "y": rng.uniform(2.8, 6.0),
            "radius": 0.03,
            "height": 0.4,
        },
    ]
    return Scene.model_validate(
        {
            "name": f"calibration {seed}",
            "length": 7.0,
            "soil": {
                "model": "fixed",
                "permittivity": soil["permittivity"],
                "conductivity": soil["conductivity"],
            },
            "surface": {
                "rms_height": 0.006,
                "correlation_length": 0.1,
                "slope": 0.0,
                "texture_shape": None,
            },
            "targets": targets,
            "objects": bodies,
            "track": {"positions": tuple(run["pose"].values[:, 1].tolist())},
        }
    )


def _alarms(image: NDArray[np.complex64], truth: pd.DataFrame) -> pd.DataFrame:
    """Return the alarms of a VV image in the lane, strongest first.

    Each has the mine that it hits, 0 for none.
    """
    view = xr.DataArray(
        np.abs(image).astype(np.float64), dims=("y", "x"), coords={"y": _GRID.y, "x": _GRID.x}
    )
    alarms = prescreen(view, LANE, _RADIUS)
    alarms = alarms[LANE.contains(alarms["x"], alarms["y"])].reset_index(drop=True)
    near = np.hypot(*(alarms[[axis]].to_numpy() - truth[axis].to_numpy() for axis in ("x", "y")))
    return alarms.assign(label=np.where(near.min(axis=1) <= _HALO, near.argmin(axis=1) + 1, 0))


def _fate(
    target: tuple[str, float, float],
    before: NDArray[np.complex64],
    after: NDArray[np.complex64],
    mask: NDArray[np.bool_],
    alarms: pd.DataFrame,
) -> dict[str, Any]:
    """Return what becomes of a target's peak, and the share of it that is masked."""
    name, x, y = target
    near = np.hypot(_GRID.points()[..., 0] - x, _GRID.points()[..., 1] - y) <= 0.4
    peaks = {
        p: 20 * np.log10(np.abs(after[i][near]).max() / np.abs(before[i][near]).max())
        for p, i in (("VV", 0), ("HH", 1))
    }
    strong = np.where(near, np.abs(before[0]), 0)
    response = strong >= strong.max() / 2
    hit = np.flatnonzero(np.hypot(alarms["x"] - x, alarms["y"] - y) <= _HALO)
    rank = int(hit[0]) + 1 if hit.size and "mine" in name else 0
    above = int((alarms["label"].to_numpy()[: rank - 1] == 0).sum()) if rank else -1
    return {
        "object": name,
        **peaks,
        "masked": float(mask[response].mean()),
        "rank": rank,
        "above": above,
    }
