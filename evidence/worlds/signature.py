"""Signal to clutter of every target of a lane, measured on simulated images."""

from __future__ import annotations

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from flgpr.imaging import ScanImager
from flgpr.model import Grid, Sensor
from flgpr.simulate import Scene, Simulator
from flgpr_papers.kit.scenes import changed

FloatArray = NDArray[np.float64]
AHEAD = 12.0
"""Distance ahead of the array about which a target is imaged, m."""
_STATIONS = 6.0  # m between stations from which targets are imaged
# m about a target within which its peak is taken: refraction shifts it by 0.2 to 0.4 m
_REACH = 0.75
_ROWS = 0.5  # m of ground range about a target over which the clutter is averaged
_SPACING = 0.1  # m


def signal_to_clutter(
    scene: Scene, sensor: Sensor, seed: int, band: tuple[float, float]
) -> FloatArray:
    """Compute the signal to clutter of every target (target,) in HH images, dB.

    Signal is the peak power of the targets' own echoes, which come through the same ground and
    holes, within 0.75 m of a target. Clutter is the mean power of all else over the lane at the
    same distance ahead, about 12 m, over all stations. The radar's errors and noise are left out.

    Parameters
    ----------
    scene : Scene
        The lane.
    sensor : Sensor
        The radar.
    seed : int
        Seed of what the scene leaves to chance.
    band : tuple of float
        Band of the images, Hz.
    """
    half = _STATIONS / 2
    stations = np.arange(-AHEAD + half, scene.length - AHEAD + half, _STATIONS)
    track = {"positions": tuple(stations.tolist()), "wander": 0.0, "attitude": 0.0, "bounce": 0.0}
    hh_sensor = sensor.model_copy(update={"polarization": ("HH",)})
    simulator = Simulator(changed(scene, track=track), hh_sensor, seed, errors=False)
    run = simulator.run()
    echoes = simulator.run(bodies=True)
    reach = max(abs(scene.x_min), abs(scene.x_max)) + _REACH
    grid = Grid.spanning((-reach, reach), (AHEAD - half - 1, AHEAD + half + 1), _SPACING)
    signal = _powers(echoes, grid, band)
    clutter = _powers(run.assign(signal=run["signal"] - echoes["signal"]), grid, band)
    in_lane = (grid.x >= scene.x_min) & (grid.x <= scene.x_max)
    by_row = clutter[..., in_lane].mean(axis=(0, 2))
    ratios = []
    for target in simulator.world.targets:
        station = int(np.argmin(np.abs(stations + AHEAD - target.y)))
        ahead = target.y - simulator.pose[station, 1]
        across = target.x - simulator.pose[station, 0]
        is_near_x = np.abs(grid.x - across) <= _REACH
        is_near_y = np.abs(grid.y - ahead) <= _REACH
        peak = signal[station][np.ix_(is_near_y, is_near_x)].max()
        level = by_row[np.abs(grid.y - ahead) <= _ROWS].mean()
        ratios.append(10 * np.log10(peak / level))
    return np.array(ratios)


def _powers(run: xr.Dataset, grid: Grid, band: tuple[float, float]) -> FloatArray:
    """Return the power (scan, y, x) of the images of a run with one polarization."""
    imager = ScanImager(run, grid, {"band": band})
    return np.stack([np.abs(image.values[0, 0]).astype(np.float64) ** 2 for image in imager])
