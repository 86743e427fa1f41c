"""The suppression of Fuse et al. 2018 on the packaged full-wave lane: one band, three frames.

``python evidence/fuse2018_full_wave.py`` prints the table of that lane in
docs/evidence/papers/fuse2018.md and draws docs/images/fuse2018-fullwave.png. The thresholds come
from simulated lanes of its kind. The full-wave data have a scale of their own, so thresholds are
learnt and used in units of each image's median magnitude in each sub-region. Nothing else passes
from one to the other, and the full-wave lane's truth is used only to measure what becomes of each
object.
"""

from __future__ import annotations

import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from common import markdown
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
from flgpr.model import Grid, Sensor, check_tones, vehicle_to_lane
from flgpr.report import figure_png
from flgpr.simulate import Scene, Simulator
from flgpr.store import open_run, read_table, sample_lane, write_whole
from flgpr_papers.kit.figures import colour_bar, decibels, show, subplots

HALF_WIDTH = 1.4
"""Half width of the imaged ground, m."""
ROADSIDES = {
    "scaled with the image": (0.4 * HALF_WIDTH, HALF_WIDTH),
    "beside the lane": (1.0, HALF_WIDTH),
}
"""Rules of where the roadside lies: nearest and farthest distance from the middle, m.

The lane of this run is 1 m to either side of the middle. The paper's roadside begins at 4 of 10 m.
"""
# from 1.2 m ahead of the last frame's array on
_GRID = Grid.spanning((-HALF_WIDTH, HALF_WIDTH), (2.56, 6.2), 0.025)
_EDGES = np.linspace(2.56, 6.2, 5)
_DECLARED = tomllib.loads(Path(__file__).with_suffix(".toml").read_text("utf-8"))
_POLARIZATIONS = ("VV", "HH", "VH")
_REACH = 0.4  # m about a body within which its response is measured
_WORLDS = 24  # calibration lanes
_PICTURE = Path(__file__).parents[1] / "docs" / "images" / "fuse2018-fullwave.png"
_RANGE = 40.0  # dB shown


def main() -> None:
    """Clean the packaged full-wave lane by every method and roadside rule."""
    folder = sample_lane()
    run = open_run(folder / "run.zarr")
    limits = calibrate(run, _WORLDS)
    frames = Frames(run)
    bodies = []
    truth = read_table(folder / "truth.csv", "truth")
    for kind, depth, x, y in truth[["kind", "depth", "x", "y"]].values:
        bodies.append((f"{kind} mine, {100 * depth:g} cm", x, y))
    for kind, x, y in read_table(folder / "objects.csv", "objects")[["kind", "x", "y"]].to_numpy():
        bodies.append((kind, x, y))
    figure, panels = subplots(9.5, 5.8, 2, 4, sharex=True, sharey=True)
    columns: dict[str, list[str]] = {}
    for row, (rule, side) in zip(panels, ROADSIDES.items(), strict=True):
        mask = frames.mask(limits[rule], side)
        cleaned = frames.clean(mask)
        for method, image in cleaned.items():
            changes = [change_db(body[1:], frames.images, image) for body in bodies]
            columns[f"{rule}, {method}"] = [f"{vv:+.1f} / {hh:+.1f}" for vv, hh in changes]
        draw_rule(row, rule, mask, {"none": frames.images, **cleaned}, bodies)
    names = [name for name, *_ in bodies]
    head = ["change in VV / HH (dB)", *columns]
    print(markdown(head, zip(names, *columns.values(), strict=True)))
    for axes in panels[:, 0]:
        axes.set_ylabel("y (m)")
    for axes in panels[-1]:
        axes.set_xlabel("x (m)")
    colour_bar(panels, panels[0, 1].images[0], "dB under the VV peak")
    write_whole(_PICTURE, figure_png(figure, 80))


def draw_rule(
    row: Any,
    rule: str,
    mask: NDArray[np.bool_],
    images: dict[str, NDArray[np.complex64]],
    bodies: list[tuple[str, float, float]],
) -> None:
    """Draw the mask of a roadside rule, and VV as it is and by two methods."""
    show(row[0], mask, _GRID.x, _GRID.y, 0, 1, cmap="gray")
    row[0].set_title(f"mask, roadside {rule}", fontsize=9)
    top = np.abs(images["none"][0]).max()
    for axes, method in zip(row[1:], ("none", "iteration", "least squares"), strict=True):
        level = decibels(np.abs(images[method][0]) / top)
        show(axes, level, _GRID.x, _GRID.y, -_RANGE, 0, cmap="viridis")
        axes.set_title("VV as it is" if method == "none" else f"VV, {method}", fontsize=9)
    for axes in row:
        for mark, (_, x, y) in zip("^^^xs", bodies, strict=True):
            edge = "C2" if mark == "^" else "C3"
            axes.plot(x, y, mark, mfc="none", mec=edge, color="C3", ms=9)


class Frames:
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


def calibrate(run: xr.Dataset, worlds: int) -> dict[str, Thresholds]:
    """Learn the thresholds of every roadside rule on simulated lanes."""
    calibrations = {name: ThresholdCalibration(len(_EDGES) - 1) for name in ROADSIDES}
    sensor = sensor_of(run)
    across = np.abs(_GRID.points()[..., 0])
    for seed in range(worlds):
        simulator = Simulator(_scene(run, seed), sensor, seed)
        frames = Frames(simulator.run())
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


def sensor_of(run: xr.Dataset) -> Sensor:
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


def change_db(
    place: tuple[float, float], before: NDArray[np.complex64], after: NDArray[np.complex64]
) -> tuple[float, float]:
    """Return what becomes of a body's peak in VV and HH, dB."""
    points = _GRID.points()
    is_near = np.hypot(points[..., 0] - place[0], points[..., 1] - place[1]) <= _REACH
    peaks = [np.abs(image[:2, is_near]).max(axis=1) for image in (before, after)]
    vv, hh = 20 * np.log10(peaks[1] / peaks[0])
    return float(vv), float(hh)


if __name__ == "__main__":
    main()
