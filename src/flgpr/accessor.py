"""``run.flgpr``: plots and checks of a run in a notebook.

Every dataset has it as soon as ``flgpr`` is imported; this module is loaded when it is first used.
"""

from __future__ import annotations

import html
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from flgpr.health.channels import channel_health
from flgpr.imaging import ScanImager
from flgpr.imaging.ground import covered_ground
from flgpr.model import Grid, Lane, check_run, complete_scans, vehicle_to_lane
from flgpr.results.description import describe_run
from flgpr.results.notebook_html import entries_html, picture_html, side_by_side_html
from flgpr.screen import run_view

_RANGE = 40.0  # dB


class RunAccessor:
    """Plots and checks of a run, as ``run.flgpr``; a notebook shows a summary and a plan of it.

    They are :meth:`health`, :meth:`describe`, :meth:`imager`, ``plot.geometry()``,
    ``plot.scan(k)`` and ``plot.run_view()``.
    """

    def __init__(self, run: xr.Dataset) -> None:
        self._run = run

    @property
    def plot(self) -> RunPlots:
        """Plots of the run."""
        return RunPlots(check_run(self._run))

    def _repr_html_(self) -> str:
        try:
            check_run(self._run)
        except ValueError as error:
            return f"<p>This dataset is no run: {html.escape(str(error))}</p>"
        title = html.escape(str(self._run.attrs.get("title", "run")))
        figure = Figure(figsize=(4.5, 3.5), layout="constrained")
        self.plot.geometry(figure.subplots())
        picture = picture_html(figure, "plan of scans and antennas")
        scans = str(self._run.sizes["scan"])
        incomplete = int(np.count_nonzero(~complete_scans(self._run)))
        if incomplete:
            scans += f", {incomplete} of them with missing sweeps"
        tones = self._run["frequency"].values / 1e9
        pose = self._run["pose"].values
        driven = float(np.hypot(*np.diff(pose[:, :2], axis=0).T).sum())
        table = entries_html(
            {
                "scans": scans,
                "polarizations": ", ".join(
                    str(label) for label in self._run["polarization"].values
                ),
                "antenna pairs": str(self._run.sizes["pair"]),
                "tones": f"{tones.size}, {tones[0]:.4g} to {tones[-1]:.4g} GHz",
                "driven": f"{driven:.4g} m",
                "height": f"{float(pose[:, 2].mean()):.3g} m",
            }
        )
        return f"<p><b>{title}</b></p>{side_by_side_html(picture, table)}"

    def health(self) -> pd.DataFrame:
        """Return the health of every channel, see :func:`flgpr.calibrate.channel_health`."""
        return channel_health(self._run)

    def describe(self) -> dict[str, Any]:
        """Return a description of the run, as ``flgpr info`` prints it."""
        return describe_run(check_run(self._run))

    def imager(self, grid: Grid | None = None, window: str = "hann") -> ScanImager:
        """Return the images of all complete scans over the whole band.

        By default they reach from 1 to 5 array heights ahead, and 1.2 to either side.
        """
        frequency = self._run["frequency"].values
        subbands = {"all": (float(frequency[0]), float(frequency[-1]))}
        return ScanImager(self._run, grid or _default_grid(self._run), subbands, window)


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
            antennas = np.unique(self._run[name].values, axis=0)
            style: dict[str, Any] = {"color": color, "markersize": 4, "markerfacecolor": "none"}
            for scan in (0, -1):
                in_lane = vehicle_to_lane(antennas, pose[scan])
                label = f"{name[:2]} antennas, first and last scan" if scan == 0 else None
                ax.plot(in_lane[:, 0], in_lane[:, 1], mark, label=label, **style)
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
        """Draw the run-view of uncleaned images over the whole band.

        By default it is that of the first polarization, and covers what the images of the first and
        the last scan do. The ``spacing`` of the pixels is in m.
        """
        label = self._label(polarization)
        images = self._run.sel(polarization=[label]).flgpr.imager()
        area = lane or covered_ground(images.grid, self._run["pose"].values[[0, -1]])
        grid = Grid.spanning((area.x_min, area.x_max), (area.y_min, area.y_max), spacing)
        view = run_view(images, grid, np.inf)[0, 0]
        ax = _show(view, ax, f"run-view, {label}")
        ax.set(xlabel="x cross-track (m)", ylabel="y down-track (m)")
        return ax

    def _label(self, polarization: str | None) -> str:
        """Return a polarization of the run, by default the first."""
        known = [str(label) for label in self._run["polarization"].values]
        if polarization is None:
            return known[0]
        if polarization not in known:
            raise ValueError(
                f"polarization must be one of {', '.join(known)}, got {polarization!r}"
            )
        return polarization


def _default_grid(run: xr.Dataset) -> Grid:
    """Return the grid of 1 to 5 array heights ahead of a run's array."""
    height = max(float(run["pose"].values[:, 2].mean()), 0.5)
    return Grid.spanning((-1.2 * height, 1.2 * height), (height, 5 * height), height / 40)


def _axes(size: tuple[float, float]) -> Axes:
    """Return the axes of a new figure."""
    return Figure(figsize=size, layout="constrained").subplots()


def _show(image: xr.DataArray, ax: Axes | None, title: str) -> Axes:
    """Draw the modulus of an image in dB below its brightest pixel."""
    ax = ax or _axes((4.5, 6))
    level = np.abs(image.values)
    top = float(np.nanmax(level, initial=0.0)) or 1.0
    with np.errstate(divide="ignore"):
        decibel = 20 * np.log10(level / top)
    x = image["x"].values
    y = image["y"].values
    half_x = (x[1] - x[0]) / 2
    half_y = (y[1] - y[0]) / 2
    extent = (x[0] - half_x, x[-1] + half_x, y[0] - half_y, y[-1] + half_y)
    drawn = ax.imshow(
        decibel, origin="lower", extent=extent, vmin=-_RANGE, vmax=0, cmap="viridis", aspect="equal"
    )
    figure = ax.get_figure()
    if figure is not None:
        figure.colorbar(drawn, ax=ax, label="dB re the brightest pixel", shrink=0.8)
    ax.set_title(title, fontsize="medium")
    return ax
