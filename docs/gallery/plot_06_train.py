"""
Train and save a detector
=========================

The recipe of Wang et al. 2007 computes ten features per alarm and sub-band. A Fisher discriminant, trained on lanes
with known mines, turns some of them into one confidence. It is trained on one lane here, saved, loaded and used on
another lane.
"""

import json
import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import flgpr
from flgpr.commands.simulate import simulate_lane
from flgpr.method.model import load_model
from flgpr.scoring import label_alarms, match, pd_mean, roc
from flgpr.store import read_lane, read_table

folder = Path(tempfile.mkdtemp())
(folder / "scene.toml").write_text(
    """
site = "arid-sand"
length = 30.0
x_min = -2.0
x_max = 2.0
[[draws]]
kind = "metal"
depth = 0.05
count = 5
[[draws]]
kind = "plastic"
depth = -0.15        # on the surface
count = 3
[surface]
density = 40.0       # thinned for speed
[track]
step = [2.0, 3.0]
"""
)
for name, seed in (("teach", 11), ("test", 12)):
    simulate_lane(
        folder / "scene.toml",
        sensor="sri-array",
        seed=seed,
        output=folder / f"{name}.zarr",
    )

# %%
# Training reads runs and their truth. Alarms within 1 m of a mine are its hits, all others are false alarms. On the
# command line: ``flgpr train teach.zarr --truth teach-truth.csv --lane teach-lane.toml --feature C_HH_F1 --feature
# M_VV_F1 -o model``.

trained_model = flgpr.train(
    [folder / "teach.zarr"],
    [folder / "teach-truth.csv"],
    "wang2007",
    folder / "model",
    features=("C_HH_F1", "M_VV_F1"),
    lanes=[folder / "teach-lane.toml"],
)
print(*sorted(path.name for path in (folder / "model").iterdir()), sep="\n")

# %%
# A model is words in JSON and arrays, each with its SHA-256: nothing in it is executed when it is loaded.

model = load_model(folder / "model")
print(json.dumps(model.notes, indent=1)[:900])

# %%
# Detection with the model, on the lane it has not seen. The truth file is not among what it takes.

result = flgpr.detect(
    folder / "test.zarr",
    "wang2007",
    folder / "result",
    lane=folder / "test-lane.toml",
    model=folder / "model",
)
detection = result.detections[0]
truth = read_table(folder / "test-truth.csv", "truth")
lane = read_lane(folder / "test-lane.toml")
trained = roc(detection.alarms, truth, lane)
single = detection.alarms.assign(confidence=detection.features["C_HH_F1"])
untrained = roc(single.dropna(subset=["confidence"]), truth, lane)
for name, curve in (("trained", trained), ("C_HH of F1 alone", untrained)):
    print(f"PD_mean to 0.1 per m², {name}: {pd_mean(curve):.2f}, 8 mines")

# %%
# Where the alarms lie in the plane of the two features, and the direction the discriminant looks along. Eight mines
# to learn from and eight to test on: this shows how it is done, and cannot say which of the two is better.

label = label_alarms(match(detection.alarms, truth, lane, halo=1.0))["label"]
figure, axes = plt.subplots(figsize=(6, 4.4), layout="constrained")
for kind, mark in (("false", "0.6"), ("detection", "C3"), ("ignored", "C1")):
    chosen = (label == kind).to_numpy()
    axes.loglog(
        detection.features["C_HH_F1"][chosen],
        detection.features["M_VV_F1"][chosen],
        "o",
        color=mark,
        ms=5,
        label=f"{kind} ({chosen.sum()})",
    )
axes.set(xlabel="local contrast C_HH, F1", ylabel="magnitude M_VV, F1")
axes.legend()
print("weights of the normalised features:")
classifier = trained_model.detector
for name, weight in zip(
    classifier.features, classifier.discriminant.direction_, strict=True
):
    print(f"{name:9}{weight:.2f}")
