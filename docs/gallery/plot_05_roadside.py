"""
Suppress roadside clutter
=========================

A post or a tree beside the lane is brighter than any mine, and its sidelobes cross the lane. Its response can be
modelled and taken out of the data: the imaging operator has a forward model that is its exact transpose, so that what
lies under a mask can be fitted by least squares and subtracted. This is the least-squares form of
Fuse et al. 2018, Eq. 5-6.
"""

import matplotlib.pyplot as plt
import numpy as np

from flgpr.clutter import suppress_by_model
from flgpr.imaging import ScanImager
from flgpr.kernels.windows import WINDOWS, band_weights
from flgpr.model import Grid, lane_to_scan
from flgpr.store import open_run, read_table, sample_lane

lane = sample_lane()
run = open_run(lane / "run.zarr")
truth = read_table(lane / "truth.csv", "truth")
frequency = run["frequency"].values
band = {"all": (frequency[0], frequency[-1])}
grid = Grid.spanning((-1.4, 1.4), (1.5, 5.8), 0.025)
imager = ScanImager(run, grid, band, window="hann")
scan = 0
uncleaned = imager.image(scan)

# %%
# The mask. The lane's borders, 1 m to either side, are known, the truth is not needed: whatever beside the lane outshines
# everything in the lane is roadside, plus a margin.

level = np.abs(uncleaned.sel(subband="all")).max("polarization")
inside = np.abs(level.x) <= 1.0
bright = (level > level.where(inside).max()) & ~inside
with_margin = (
    bright.rolling(x=13, y=13, center=True, min_periods=1).max().astype(bool)
)
mask = (with_margin & ~inside).transpose("y", "x").values
points = grid.points()[mask]
print(f"{bright.values.sum()} bright pixels, {len(points)} with their margin")

# %%
# The fit, by a few conjugate gradients. The taper over the band keeps the direct coupling between the antennas, far
# stronger than the post, from leaking into it.

taper = band_weights(frequency, (band["all"],), WINDOWS["hann"])[0]
fit = suppress_by_model(
    imager.signal(scan), imager.operator_on(scan, points), 20, taper
)
cleaned = imager.image(scan, fit.data)
peaks = []
for image in (uncleaned, cleaned):
    magnitude = np.abs(image.sel(polarization="HH", subband="all")).values
    peaks.append(magnitude[mask].max())
drop = 20 * np.log10(peaks[0] / peaks[1])
print(f"peak under the mask: down by {drop:.1f} dB")

# %%
# Before, after, and what was subtracted, on one scale. Mines are circles. The arc that passes the second metal mine
# goes, the mine stays.

figure, panels = plt.subplots(
    1, 3, figsize=(9.5, 5.2), sharey=True, layout="constrained"
)
top = float(np.abs(uncleaned.sel(polarization="HH")).max())
images = {
    "before": uncleaned,
    "after": cleaned,
    "subtracted": uncleaned - cleaned,
}
places = lane_to_scan(
    np.column_stack([truth.x, truth.y, 0 * truth.x]), uncleaned.attrs["pose"]
)
for axes, (title, image) in zip(panels, images.items(), strict=True):
    in_hh = image.sel(polarization="HH", subband="all")
    decibel = 20 * np.log10(np.abs(in_hh) / top + 1e-6)
    drawn = axes.pcolormesh(
        grid.x, grid.y, decibel, vmin=-45, vmax=0, cmap="magma"
    )
    axes.contour(grid.x, grid.y, mask, [0.5], colors="w", linewidths=0.6)
    axes.plot(places[:, 0], places[:, 1], "co", mfc="none", ms=14)
    axes.set(title=title, xlabel="x (m)", aspect="equal")
panels[0].set_ylabel("ahead of the array (m)")
figure.colorbar(drawn, ax=panels, label="dB, HH", shrink=0.7)

# %%
# Under the mask nothing can be found any more, by construction: that is the price, and why the mask must never enter
# the lane. In a recipe, the clutter stage ``roadside`` does this for every scan, and the feature stage of that
# name gives each alarm a column ``roadside``, the share of its amplitude that the modelled roadside explains.
