"""
Your own data
=============

Recordings come as arrays in somebody's own layout. A mapping, one TOML file, says which variable is what and in which
unit; nothing is guessed on import. Here a file is made first, as a data logger might have written it, and then taken
in as if nothing were known about it.
"""

import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from flgpr.formats import explain_file, import_mapped
from flgpr.store import open_run, sample_lane, save_run

folder = Path(tempfile.mkdtemp())
known = open_run(sample_lane() / "run.zarr")
np.savez(
    folder / "log.npz",
    s=np.conj(
        known["signal"].transpose("frequency", "scan", "polarization", "pair")
    ),
    freq_GHz=known["frequency"].values / 1e9,
    tx_cm=100 * known["tx_position"].values,
    rx_cm=100 * known["rx_position"].values,
    east_m=known["pose"].values[:, 0],
    north_m=known["pose"].values[:, 1],
    yaw_deg=np.degrees(known["pose"].values[:, 3]),
)

# %%
# What is in it? ``flgpr info log.npz`` prints the same.

explained = explain_file(folder / "log.npz")
print(explained.kind, *explained.lines, sep="\n")

# %%
# It also drafts a mapping. What ends in a question mark is a guess, and the import refuses it until somebody who
# knows the radar has taken the question mark away.

print(explained.mapping)

# %%
# The finished mapping. This logger stores the conjugate field, its axes are in another order, and its positions are
# in centimetres: the mapping says each of these once.

(folder / "log.toml").write_text(
    """
title = "logger"
files.data = "log.npz"
polarization = ["HH", "VV", "HV", "VH"]

[signal]
variable = "s"
dims = ["frequency", "scan", "polarization", "pair"]
conjugate = true

[frequency]
variable = "freq_GHz"
unit = "GHz"

[tx_position]
variable = "tx_cm"
unit = "cm"

[rx_position]
variable = "rx_cm"
unit = "cm"

[pose]                        # a number, or the name of a variable
x = "east_m"
y = "north_m"
z = 1.5
heading = "yaw_deg"
pitch = 0
roll = 0
unit = "m"
angle_unit = "deg"
"""
)
arrived = import_mapped(folder / "log.toml")
save_run(arrived.run, folder / "lane.zarr")
print(arrived.run)

# %%
# A look at the geometry and at the first image says more about a wrong sign or unit than any check: with the sign of
# the phase wrong, nothing focuses.

run = open_run(folder / "lane.zarr")
figure, panels = plt.subplots(1, 2, figsize=(9, 5), layout="constrained")
run.flgpr.plot.geometry(ax=panels[0])
run.flgpr.plot.scan(0, "HH", ax=panels[1])
assert np.allclose(run["signal"], known["signal"], rtol=1e-5)

# %%
# From here on it is a run like any other: ``flgpr detect lane.zarr -o result``. Poses may also come from a survey, a CSV
# track or an NMEA log. `Import your own arrays <../guide/import-mapping.html>`_ has all entries, and
# `Calibrate a run <../guide/calibrate.html>`_ helps where a clock is off, or pair delays or a lever arm are unknown.
