"""
Live on a vehicle
=================

``flgpr live INCOMING/`` raises alarms while the vehicle drives: after every scan the background,
the run-view and the alarms are brought up to date. It writes one JSON line per event. Here a stored
lane is played into a folder as a radar would write it, and the events are looked at. In two
terminals that is::

    flgpr live incoming/ --recipe wang2007 --lane lane-lane.toml --speed 15 --view
    flgpr feed lane.zarr incoming/ --rate 4.2
"""

import json
import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd

from flgpr.commands.simulate import simulate_lane
from flgpr.live.feeding import feed
from flgpr.live.options import LiveOptions
from flgpr.live.session import LiveRun
from flgpr.model.vehicle import Vehicle
from flgpr.store import read_table

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
count = 4
[surface]
density = 40.0              # thinned for speed
[track]
step = [1.0, 1.3]           # m between scans: 4.2 m/s at about four scans a second
"""
)
simulate_lane(
    folder / "scene.toml", sensor="sri-array", seed=5, output=folder / "lane.zarr"
)

# %%
# The radar's part: ``run.json`` with tones and antennas, then one file per scan, at last ``end.json``. A rate this high
# plays it as fast as it can be read.

count = feed(folder / "lane.zarr", folder / "incoming", rate=1e4)
names = sorted(path.name for path in (folder / "incoming").iterdir())
print(f"{count} scans:", *names[:2], "...", names[-1])

# %%
# The detector's part. The vehicle drives 15 km/h, its bumper half a metre ahead of the array.

events = []
options = LiveOptions(
    "wang2007",
    folder / "out",
    folder / "incoming",
    lane=folder / "lane-lane.toml",
    vehicle=Vehicle(speed=15 / 3.6, front=0.5),
)
report = LiveRun(options, lambda line: events.append(json.loads(line))).run()
for name, value in report.counts.items():
    if value:
        print(f"{name:10}{value:4}")

# %%
# The alarms. ``left_m`` is the way left to the alarm when the newest scan was taken, ``margin_m`` what remains of it
# after the stopping distance. An alarm may still move, rise or be withdrawn while scans come in.

alarms = pd.DataFrame([event for event in events if event["event"] == "alarm"])
alarms["state"].value_counts()

# %%
# The confidence so far of the alarms at mines, over the way left. It need not rise: each scan adds a look, nearer and at
# another angle. Right of the line the vehicle can no longer stop, so that only what came before counts.

truth = read_table(folder / "lane-truth.csv", "truth")
stop = 15 / 3.6 * 1.5 + (15 / 3.6) ** 2 / (2 * 3.0)
figure, axes = plt.subplots(figsize=(6.4, 4), layout="constrained")
for _, target in truth.iterrows():
    distance = np.hypot(alarms.x - target.x, alarms.y - target.y)
    of_target = alarms[distance < 1.0]
    of_target = of_target[of_target.state.isin(["new", "update"])]
    if len(of_target):
        axes.plot(
            of_target.left_m,
            of_target.confidence,
            ".-",
            label=f"mine at {target.y:.1f} m",
        )
axes.axvline(stop, color="C3", ls="--", label=f"stopping distance, {stop:.1f} m")
axes.set(xlabel="way left (m)", ylabel="confidence so far", ylim=(0, None))
axes.invert_xaxis()
axes.legend(fontsize=8)

# %%
# The folder holds the alarms for ``flgpr score``, the events for the viewer and a snapshot from which a stopped run
# resumes. `Detect while driving <../guide/live.html>`_ has the command,
# `What a radar gets wrong <../guide/live-faults.html>`_ what is done about scans that are lost, late or broken.

print(*sorted(path.name for path in (folder / "out").iterdir()), sep="\n")
