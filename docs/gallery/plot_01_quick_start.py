"""
Quick start
===========

A run, its alarms and their score in ten lines, with objects in memory. The data are a full-wave computation of the
packaged lane by a solver that is not part of flgpr: two metal mines, a plastic one, a rock, and a post at the roadside
that outshines them all. ``flgpr demo`` does the same on the command line.
"""

import flgpr

lane = flgpr.sample_lane()
run = flgpr.open_run(lane / "run.zarr").load()
run.flgpr

# %%
# A run is an xarray dataset. ``run.flgpr`` shows what it holds, and draws it: here the largest responses of all scans,
# laid out on the lane.

figure = run.flgpr.plot.run_view("HH").figure

# %%
# Detection takes a run, in memory or as the path of its store, and a recipe. It never sees the truth.

result = flgpr.detect(run, "demo")
result

# %%
# ``result.alarms`` is a table, the most mine-like alarm first.

result.alarms.head(3)

# %%
# Scoring reads the truth, and says what became of each mine, and how many false alarms rank above it. Three mines on
# one lane say that the chain works, not how well.

scored = flgpr.score(result, truth=lane / "truth.csv")
scored

# %%
# Without a place to write to, the result lives as long as the object. ``flgpr.detect(run, "demo", "result")`` keeps it:
# its ``report.html`` holds all of it on one page, and ``flgpr view result`` shows it in the browser.
# `What is found <../guide/first-lane.html#what-is-found>`_ says what became of each mine.
