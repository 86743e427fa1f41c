"""
On a cluster
============

A survey is many lanes with one recipe. ``flgpr detect a.zarr b.zarr ... -o survey`` works through
them, with ``--workers 8`` in eight processes of this machine, with ``--scheduler tcp://host:8786``
on a Dask cluster. Whoever does the work, the files are the same to the byte. This page starts a
small cluster on one machine and shows it.

Install the extra first: ``pip install "flgpr[cluster]"``.
"""

import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import flgpr
from flgpr.commands.simulate import simulate_lane
from flgpr.results.result import read_result

folder = Path(tempfile.mkdtemp())
(folder / "scene.toml").write_text(
    """
site = "arid-sand"
length = 8.0
[[draws]]
kind = "metal"
depth = 0.02
count = 2
[surface]
density = 20.0              # thinned for speed
[track]
step = [3.0, 4.0]
"""
)
lanes = ("north", "south")
for seed, name in enumerate(lanes):
    scene = folder / "scene.toml"
    store = folder / f"{name}.zarr"
    simulate_lane(scene, sensor="sri-array", seed=seed, output=store)
runs = [folder / f"{name}.zarr" for name in lanes]
areas = [folder / f"{name}-lane.toml" for name in lanes]

# %%
# The cluster: one scheduler, and a worker on every machine that helps. Runs, models and the output folder must have the
# same path for all of them (a shared file system), and all the same versions. Under a batch system, the worker's line is
# what goes into the job script. Here both run beside this page::
#
#     dask scheduler --scheduler-file cluster.json
#     dask worker --scheduler-file cluster.json --nthreads 1


def start(*arguments):
    """Start one of Dask's commands beside this program."""
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    return subprocess.Popen(
        [sys.executable, "-m", "dask", *map(str, arguments)], **quiet
    )


scheduler_file = folder / "cluster.json"
local = ("--host", "127.0.0.1", "--no-dashboard")
processes = [
    start("scheduler", "--scheduler-file", scheduler_file, "--port", 0, *local)
]
while not scheduler_file.exists():
    time.sleep(0.1)
processes.append(
    start(
        "worker",
        "--scheduler-file",
        scheduler_file,
        "--nthreads",
        1,
        "--no-nanny",
        *local,
    )
)
address = json.loads(scheduler_file.read_text())["address"]

# %%
# The same survey twice: in this process, and on the cluster, both lanes at once. Only small values travel through Dask;
# arrays stay in a work folder beside the output, from which a survey that was stopped goes on.

in_process = flgpr.detect(runs, "wang2007", folder / "here", areas, report=False)
on_cluster = flgpr.detect(
    runs,
    "wang2007",
    folder / "cluster",
    areas,
    report=False,
    lanes_at_once=2,
    scheduler=address,
)
for process in reversed(processes):
    process.terminate()
    process.wait()

# %%
# The manifests hold the SHA-256 of every file.

for own, other in zip(in_process, on_cluster, strict=True):
    files = own.manifest["files"]
    other_files = other.manifest["files"]
    different = [name for name in files if files[name] != other_files[name]]
    print(own.folder.name, len(files), "files,", len(different), "different")

# %%
# And ``survey.json`` says how each lane went. `Many workers <../guide/cluster.html>`_ says what happens to workers that
# are lost, and `Many workers, measured <../evidence/workers.html>`_ what a cluster costs and gains.

print((folder / "cluster" / "survey.json").read_text()[:600])
