"""
Your own array in one TOML
==========================

A sensor is one TOML file: tones, polarizations, antenna positions, height, tilt, antenna pattern,
errors. Write yours down, and you can see what it resolves, simulate lanes with it and image its
data, before anything is built.

The array here is a small one: 2 transmitters and 12 receivers on a bar 1.6 m wide, 1.8 m above the ground.
"""

import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from flgpr.imaging import ImagingOperator, ScanImager
from flgpr.model import Grid, load_sensor
from flgpr.screen import run_view
from flgpr.simulate import Scene, simulate

folder = Path(tempfile.mkdtemp())
(folder / "bar.toml").write_text(
    """
name = "bar"
source = "an example"
polarization = ["HH", "VV"]
height = 1.8                  # m, of the array's reference point
tilt = 0.35                   # rad, downwards
footprint = [-3.0, 3.0, 1.5, 8.0]   # ground that a simulation fills, m

[tones]
start = 0.5e9                 # Hz
step = 10e6
count = 151

[tx]
first = [-0.8, 0.0, 0.0]      # m: right, forward, up from the reference point
last = [0.8, 0.0, 0.0]
count = 2

[rx]
first = [-0.75, 0.0, 0.0]
last = [0.75, 0.0, 0.0]
count = 12

[antenna]
kind = "horn"
gain_db = 6.0

[errors]
clutter_to_noise_db = 15.0
noise_range = 5.0
noise_band = [0.5e9, 2.0e9]
"""
)
sensor = load_sensor(folder / "bar.toml")
tx, rx = sensor.pairs()
frequency = sensor.tones.axis()
print(f"{len(tx)} pairs, {frequency[0] / 1e9:g} to {frequency[-1] / 1e9:g} GHz")

# %%
# What does it resolve? Model the data of a point with the operator itself, and image them.
# Range resolution is about c/2B over the cosine of the grazing angle; cross-range resolution follows from the width
# of the array as the point sees it.

up = np.array([0.0, 0.0, sensor.height])
patch = Grid.spanning((-1.0, 1.0), (3.5, 5.5), 0.02)
point = np.array([[0.0, 4.5, 0.0]])
echo = ImagingOperator(frequency, tx + up, rx + up, point).forward(
    np.ones((1, 1, 1), np.complex64)
)
operator = ImagingOperator(
    frequency, tx + up, rx + up, patch.points(), window="hann"
)
response = np.abs(operator.adjoint(echo)[0, 0])
decibel = 20 * np.log10(response / response.max())
above = decibel > -3
print(f"half-power width: {above.any(axis=0).sum() * 2} cm cross-track, ", end="")
print(f"{above.any(axis=1).sum() * 2} cm down-track")

figure, axes = plt.subplots(figsize=(5.6, 4.4), layout="constrained")
picture = axes.pcolormesh(
    patch.x, patch.y, decibel, vmin=-40, vmax=0, cmap="magma"
)
axes.contour(patch.x, patch.y, decibel, [-3], colors="c")
axes.set(xlabel="cross-track x (m)", ylabel="ahead y (m)", aspect="equal")
axes.set_title("image of a point 4.5 m ahead")
figure.colorbar(picture, label="dB; line: -3 dB")

# %%
# Now a lane for it: a metal mine 2 cm deep in dry sand and a plastic one lying on it, five scans half a metre apart.
# The sensor's errors are those of the TOML, here noise alone. The run-view keeps, for every place, the
# second largest response of all scans: what shines from everywhere stays, speckle that flashes once does not.

scene = Scene(
    site="arid-sand",
    length=6.0,
    targets=[
        {"kind": "metal", "x": 0.4, "y": 3.6, "depth": 0.02},
        {"kind": "plastic", "x": -0.5, "y": 4.6, "depth": -0.15},
    ],
    clutter={"rocks": 0.0, "bushes": 0.0, "posts": 0.0, "patches": 0.0},
    surface={"density": 300.0},
    track={"positions": [-1.0, -0.5, 0.0, 0.5, 1.0]},
)
run, truth = simulate(scene, sensor, seed=1)
grid = Grid.spanning((-1.5, 1.5), (2.0, 6.5), 0.025)
band = {"all": (frequency[0], frequency[-1])}
imager = ScanImager(run, grid, band, window="hann")
ground = Grid.spanning((-1.5, 1.5), (2.5, 5.5), 0.025)
view = run_view(imager, ground, 6.5)
figure, panels = plt.subplots(1, 2, figsize=(8, 4.4), layout="constrained")
for axes, polarization in zip(panels, sensor.polarization, strict=True):
    level = view.sel(polarization=polarization, subband="all")
    level = 20 * np.log10(level / level.max())
    picture = axes.pcolormesh(ground.x, ground.y, level, vmin=-25, vmax=0)
    axes.plot(truth.x, truth.y, "wo", mfc="none", ms=22)
    axes.set(title=polarization, xlabel="x (m)", aspect="equal")
panels[0].set_ylabel("y (m)")
figure.colorbar(picture, ax=panels, label="dB of the run-view", shrink=0.7)

# %%
# Neither mine shines at its centre. The one on the ground answers from its front edge, nearer to the radar; the buried
# one from its two rims, in VV the far one stronger, and refraction moves both away:
# `Mine signatures <../reference/theory/signatures.html>`_ and `Refraction <../reference/theory/refraction.html>`_ tell why.
#
# ``flgpr simulate scene.toml -o lane.zarr --sensor bar.toml`` does the same from files, and every preset can be the
# start of yours: ``src/flgpr/model/presets`` holds the four papers' radars.
