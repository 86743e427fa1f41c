"""
From lane to ROC
================

A scene is written down, simulated, detected on and scored: the whole way, in five steps.
"""

import tempfile
from pathlib import Path

import numpy as np

import flgpr
from flgpr.commands.simulate import simulate_lane
from flgpr.commands.simulation import preview_figure
from flgpr.scoring import band, match, pd_mean, pd_mean_interval
from flgpr.simulate import load_scene
from flgpr.trials import roc_figure

folder = Path(tempfile.mkdtemp())

# %%
# 1. The scene. A site gives soil, surface and clutter; what the scene states itself comes before it. The lane is short
# so that this page builds quickly.

(folder / "scene.toml").write_text(
    """
name = "short lane"
site = "arid-sand"
length = 36.0               # m
x_min = -2.0
x_max = 2.0

[[draws]]
kind = "metal"
depth = 0.05
count = 5

[[draws]]
kind = "plastic"
depth = 0.05
count = 3

[surface]
density = 40.0              # scatterers per m², thinned for speed

[track]
step = [2.0, 3.0]
"""
)
scene = load_scene(folder / "scene.toml")
preview = preview_figure(scene, seed=3)

# %%
# 2. The radar drives along it. The world depends on the seed alone, so another radar with the same seed sees the same
# lane.

written = simulate_lane(
    folder / "scene.toml", sensor="sri-array", seed=3, output=folder / "lane.zarr"
)
print(*(path.name for path in written.paths), sep="\n")

# %%
# 3. Detection, by the recipe of Wang et al. 2007. Lane borders are given; truth is not.

result = flgpr.detect(
    folder / "lane.zarr",
    "wang2007",
    folder / "result",
    lane=folder / "lane-lane.toml",
)
alarms = result.detections[0].alarms
alarms.head()

# %%
# 4. Scoring, by the halo rules: an alarm within 1 m of a mine detects it, further alarms there are ignored, and
# everything else on the lane is false.

_, scored = flgpr.score(folder / "result", folder / "lane-truth.csv")
curve = scored[0].curve
curve[
    ["threshold", "pd", "pd_low", "pd_high", "far", "n_detected", "n_false"]
].round(3)

# %%
# 5. The curve, with a simultaneous band by bootstrap. Eight mines leave it wide, and that is the finding: sample sizes
# come first (``flgpr plan mines``).

matched = match(alarms, scored[0].outcomes, result.lane, halo=1.0)
shown = band(matched, far=np.linspace(0, 0.3, 61), draws=100, seed=0)
figure = roc_figure(
    {"all mines": curve},
    {"all mines": shown},
    far_max=0.3,
)
low, high = pd_mean_interval(matched, far_max=0.1, draws=100, seed=0)
print(f"PD_mean to 0.1 per m²: {pd_mean(curve):.2f} ({low:.2f} to {high:.2f})")
