"""``run.flgpr``: plots and checks of a run in a notebook. Import this module once to have it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from flgpr.calibrate import channel_health
from flgpr.imaging import ScanImager
from flgpr.model import Grid, Lane, check_run, complete_scans, vehicle_to_lane
from flgpr.results.description import describe_run
from flgpr.screen import run_view

_RANGE = 40.0  # dB


@xr.register_dataset_accessor("flgpr")  # type: ignore[no-untyped-call]
class RunAccessor:
    """What a run can show of itself: ``imager``, ``plot.geometry()``, ``plot.scan(k)``, ``plot.run_view()``."""

    def __init__(self, run: xr.Dataset) -> None:
        self._run = run

    @property
    def plot(self) -> RunPlots:
        """Plots of the run."""
        return RunPlots(check_run(self._run))

    def health(self) -> pd.DataFrame:
        """Look at every channel; see :func:`flgpr.calibrate.channel_health`."""
        return channel_health(self._run)

    def describe(self) -> dict[str, Any]:
        """Describe the run; see ``describe_run``."""
        return describe_run(check_run(self._run))

    def imager(self, grid: Grid | None = None, window: str = "hann") -> ScanImager:
        """Image all complete scans over the whole band, by default 1 to 5 array heights ahead, 1.2 to either side."""
        frequency = self._run["frequency"].values
        return ScanImager(
            self._run,
            grid or _grid(self._run),
            {"all": (float(frequency[0]), float(frequency[-1]))},
            window,
        )


class RunPlots:
    """Plots of a run; each takes axes to draw on and returns them."""

    def __init__(self, run: xr.Dataset) -> None:
        self._run = run

    def geometry(self, ax: Axes | None = None) -> Axes:
        """Draw poses and, at the first and the last scan, the antennas, seen from above."""
        ax = ax or _axes((5, 5))
        pose = self._run["pose"].values
        ax.plot(
            pose[:, 0], pose[:, 1], ".-", color="0.6", markersize=3, linewidth=0.8, label="scans"
        )
        for name, mark, color in (
            ("tx_position", "^", "tab:red"),
            ("rx_position", "o", "tab:blue"),
        ):
            places = np.unique(self._run[name].values, axis=0)
            for end in (0, -1):
                at = vehicle_to_lane(places, pose[end])
                label = f"{name[:2]} antennas, first and last scan" if end == 0 else None
                ax.plot(
                    at[:, 0],
                    at[:, 1],
                    mark,
                    color=color,
                    markersize=4,
                    markerfacecolor="none",
                    label=label,
                )
        ax.set(xlabel="x cross-track (m)", ylabel="y down-track (m)", aspect="equal")
        ax.set_adjustable("datalim")
        ax.legend(fontsize="small", loc="best")
        return ax

    def scan(
        self,
        scan: int = 0,
        polarization: str | None = None,
        grid: Grid | None = None,
        ax: Axes | None = None,
    ) -> Axes:
        """Draw a scan's image over the whole band; a negative scan counts from the end."""
        count = self._run.sizes["scan"]
        if not -count <= scan < count:
            raise ValueError(f"scan must lie between 0 and {count - 1}, got {scan}")
        scan %= count
        if not complete_scans(self._run)[scan]:
            raise ValueError(f"scan {scan} has missing sweeps, it makes no image")
        label = self._label(polarization)
        image = self._run.flgpr.imager(grid).image(scan).sel(polarization=label, subband="all")
        ax = _show(image, ax, f"scan {scan}, {label}")
        ax.set(xlabel="x right of the array (m)", ylabel="y ahead of the array (m)")
        return ax

    def run_view(
        self,
        polarization: str | None = None,
        lane: Lane | None = None,
        spacing: float = 0.1,
        ax: Axes | None = None,
    ) -> Axes:
        """Draw the run-view of uncleaned images over the whole band, of the first polarization unless told.

        Without a lane it covers what the images of the first and the last scan do; ``spacing`` of the pixels is in m.
        """
        label = self._label(polarization)
        images = self._run.sel(polarization=[label]).flgpr.imager()
        area = lane or _covered(self._run, images.grid)
        grid = Grid.spanning((area.x_min, area.x_max), (area.y_min, area.y_max), spacing)
        view = run_view(images, grid, np.inf)[0, 0]
        ax = _show(view, ax, f"run-view, {label}")
        ax.set(xlabel="x cross-track (m)", ylabel="y down-track (m)")
        return ax

    def _label(self, polarization: str | None) -> str:
        known = [str(label) for label in self._run["polarization"].values]
        if polarization is None:
            return known[0]
        if polarization not in known:
            raise ValueError(
                f"polarization must be one of {', '.join(known)}, got {polarization!r}"
            )
        return polarization


def _grid(run: xr.Dataset) -> Grid:
    height = max(float(run["pose"].values[:, 2].mean()), 0.5)
    return Grid.spanning((-1.2 * height, 1.2 * height), (height, 5 * height), height / 40)


def _covered(run: xr.Dataset, grid: Grid) -> Lane:
    corners = np.array([[x, y, 0] for x in grid.extent()[:2] for y in grid.extent()[2:]])
    ends = run["pose"].values[[0, -1]].copy()
    ends[:, [2, 4, 5]] = 0
    places = vehicle_to_lane(corners, ends).reshape(-1, 3)
    return Lane(*(float(v) for k in (0, 1) for v in (places[:, k].min(), places[:, k].max())))


def _axes(size: tuple[float, float]) -> Axes:
    return Figure(figsize=size, layout="constrained").subplots()


def _show(image: xr.DataArray, ax: Axes | None, title: str) -> Axes:
    ax = ax or _axes((4.5, 6))
    level = np.abs(image.values)
    top = float(np.nanmax(level, initial=0.0)) or 1.0
    with np.errstate(divide="ignore"):
        decibel = 20 * np.log10(level / top)
    x, y = image["x"].values, image["y"].values
    half = ((x[1] - x[0]) / 2, (y[1] - y[0]) / 2)
    extent = (x[0] - half[0], x[-1] + half[0], y[0] - half[1], y[-1] + half[1])
    drawn = ax.imshow(
        decibel, origin="lower", extent=extent, vmin=-_RANGE, vmax=0, cmap="viridis", aspect="equal"
    )
    figure = ax.get_figure()
    if figure is not None:
        figure.colorbar(drawn, ax=ax, label="dB re the brightest pixel", shrink=0.8)
    ax.set_title(title, fontsize="medium")
    return ax
