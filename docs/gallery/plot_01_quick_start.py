"""
Quick start
===========

``make demo`` installs flgpr and runs ``flgpr demo``: the packaged lane goes from raw data to images, alarms and a
score. Here the same is done from Python. The data are a full-wave computation by a solver that is not part of flgpr:
two metal mines, a plastic one, a rock, and a post at the roadside that outshines them all.
"""

import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import flgpr
from flgpr.commands.demo import demo
from flgpr.commands.scoring import outcome_table, score_result
from flgpr.store import open_run, read_table, sample_lane

home = Path(tempfile.mkdtemp())
lane = sample_lane()
run = open_run(lane / "run.zarr")
for name, size in run.sizes.items():
    print(f"{name:13}{size:4}")
print("polarizations:", *run["polarization"].values)

# %%
# Detection takes a run and a recipe. It never sees the truth. Here the recipe `demo` and three beside it are run on the
# packaged lane, and then scored.

result, _ = demo(home / "result")
alarms = result.detections[0].alarms
alarms.head()

# %%
# Three recipes ran beside it. Here is the run-view, the largest responses of all scans laid out on the lane, in
# dB over its median: as the recipe has it, and with the modelled response of the roadside post subtracted.

truth = read_table(lane / "truth.csv", "truth")
objects = read_table(lane / "objects.csv", "objects")
found = {one.name: one for one in result.detections}
shown = {
    "recipe": result.detections[0],
    "roadside subtracted": found["roadside-suppressed"],
}
figure, panels = plt.subplots(
    1, 2, figsize=(9, 6), sharey=True, layout="constrained"
)
for axes, (title, detection) in zip(panels, shown.items(), strict=True):
    view = detection.view.sel(polarization="HH", subband="0.45-1.5")
    decibel = 20 * np.log10(view / view.median())
    picture = axes.pcolormesh(
        view.x, view.y, decibel, vmin=0, vmax=30, cmap="magma"
    )
    axes.plot(truth.x, truth.y, "co", mfc="none", ms=16, label="mine")
    axes.plot(objects.x, objects.y, "wx", label="rock or post")
    axes.plot(detection.alarms.x, detection.alarms.y, "w+", ms=9, label="alarm")
    axes.set(title=title, xlabel="cross-track x (m)", aspect="equal")
panels[0].set_ylabel("down-track y (m)")
panels[0].legend(
    loc="lower left",
    fontsize=8,
    markerscale=0.6,
    facecolor="0.25",
    labelcolor="w",
)
figure.colorbar(picture, ax=panels, shrink=0.6, label="dB over the median")

# %%
# Scoring reads the truth, and says what became of each mine. ``n_false`` counts the false alarms with at least the
# confidence of the mine's best alarm.

_, scored = score_result(
    home / "result", lane / "truth.csv", lane / "objects.csv"
)
outcome_table(scored).round(2)

# %%
# ``report.html`` in the result folder holds all of it on one page, and ``flgpr view`` shows it in the browser. Three
# mines on one lane say that the chain works, not how well;
# `What became of each mine <../evidence/first-lane.html>`_ has the rest.

print(*sorted(path.name for path in (home / "result").iterdir()), sep="\n")
