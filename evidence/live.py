"""Time live detection as it is used: `flgpr live` in a process of its own, fed scan by scan at the radar's rate.

The lane is simulated (``sri-array``, a scan per metre, 24 targets, sensor errors, so that sweeps
are missing here and there), or given with ``--run``. Usage::

    python evidence/live.py [--rate 4.2] [--length 240] [--run lane.zarr] [--agreement]

Prints, for the recipe ``wang2007`` with the local contrast and with a model that reads features of all five sub-bands,
the latency from the arrival of a scan's file to its alarms, the rate achieved, and the processor time. The feeder,
which reads, checks and writes 0.9 MB per scan, runs on the same machine. With ``--agreement`` the alarms are compared
with those of batch detection on the same lane.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.spatial import cKDTree

from flgpr.commands.simulate import simulate_lane
from flgpr.detect import FisherDiscriminant, HistogramNormalizer
from flgpr.live.feeding import feed
from flgpr.method.classifier import Classifier
from flgpr.method.method import detect
from flgpr.method.model import load_model, save_model
from flgpr.model import Lane
from flgpr.recipe.schema import load_recipe
from flgpr.store import lane_text, open_run, read_table

SCENE = """
name = "live lane"
site = "arid-sand"
length = {length}
x_min = -1.5
x_max = 1.5
[[draws]]
kind = "metal"
depth = 0.05
count = 9
[[draws]]
kind = "plastic"
depth = 0.05
count = 9
[[draws]]
kind = "simulant"
depth = 0.075
count = 6
[track]
step = [1.0, 1.0]
wander = 0.2
"""
SETTLED = 30.0  # m of the lane after which the estimates of 50 scans and more have settled
# m
NEAR = 0.3
HALO = 1.0


def make_model(folder: Path) -> Path:
    """Save a model that reads a feature of every sub-band; what it was trained on is noise."""
    names = ("C_HH_F0", "C_HH_F1", "M_VV_F1", "P_alpha_F2", "C_VV_F3", "R_HH_HV_F4")
    rng = np.random.default_rng(1)
    label = np.arange(200) < 60
    values = rng.normal(size=(200, len(names))) + label[:, None] + 2
    normalizer = HistogramNormalizer().fit(values)
    discriminant = FisherDiscriminant().fit(normalizer.transform(values), label.astype(int))
    return save_model(Classifier(names, normalizer, discriminant), folder)


def play(
    run: Path, lane: Path, home: Path, options: argparse.Namespace, model: Path | None
) -> dict:
    """Feed a run to a process of its own; give its report."""
    home.mkdir()
    incoming = home / "incoming"
    output = home / "out"
    words = [incoming, "-o", output, "--lane", lane, "--quiet", "--recipe", "wang2007"]
    words += ["--speed", 15, "--idle", 15, *([] if model is None else ["--model", model])]
    priority = ["chrt", "-r", "1"] if options.realtime else []
    command = [*priority, sys.executable, "-m", "flgpr", "live", *map(str, words)]
    environment = {k: v for k, v in os.environ.items() if not k.endswith("_NUM_THREADS")}
    before = _processor_time()
    with subprocess.Popen(command, env=environment) as process:
        feed(run, incoming, options.rate, lead=8.0)
        process.wait(600)
    report = json.loads((output / "live.json").read_text())
    report["processor_s"] = _processor_time() - before
    report["alarms_table"] = read_table(output / "alarms.csv", "alarms")
    lines = [json.loads(line) for line in (output / "live.jsonl").read_text().splitlines()]
    report["raised"] = [one for one in lines if one["event"] == "alarm" and one["state"] == "new"]
    return report


def _processor_time() -> float:
    """Seconds that processes which have ended have computed."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def agreement(live: pd.DataFrame, batch: pd.DataFrame) -> str:
    """Compare alarm tables where the estimates have settled."""
    live = live[live["y"] > SETTLED]
    batch = batch[batch["y"] > SETTLED]
    away = cKDTree(live[["x", "y"]]).query(batch[["x", "y"]])[0]
    found = away <= NEAR
    back = cKDTree(batch[["x", "y"]]).query(live[["x", "y"]])[0] <= NEAR
    top = len(batch) // 10
    return (
        f"{found.sum()} of batch's {len(batch)} alarms are live's ({found.mean():.2f}), {found[:top].sum()} of its top "
        f"{top}; {(away <= HALO).sum()} have one of live's within {HALO:g} m; {back.sum()} of live's {len(live)} are "
        f"batch's ({back.mean():.2f})"
    )


def main() -> None:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--rate", type=float, default=4.2)
    parser.add_argument("--length", type=float, default=240.0)
    parser.add_argument("--run", type=Path, default=None)
    parser.add_argument("--agreement", action="store_true")
    parser.add_argument(
        "--realtime", action="store_true", help="real-time priority (chrt) for live"
    )
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        home = Path(folder)
        run = options.run
        if run is None:
            (home / "scene.toml").write_text(SCENE.format(length=options.length))
            run = home / "lane.zarr"
            simulate_lane(home / "scene.toml", sensor="sri-array", seed=11, output=run)
        pose = open_run(run)["pose"].values
        lane = Lane(-1.5, 1.5, float(pose[:, 1].min()) + 7.0, float(pose[:, 1].max()) + 7.0)
        (home / "lane.toml").write_text(lane_text(lane))
        model = make_model(home / "model")
        dataset = open_run(run)
        for name, chosen in (("local contrast, F1", None), ("model, F0 to F4", model)):
            start = time.perf_counter()
            told = play(
                run, home / "lane.toml", home / ("play-" + name.split()[0]), options, chosen
            )
            latency = told["latency_ms"]
            counts = told["counts"]
            left = np.median([one["raised_left_m"] for one in told["raised"]])
            in_time = np.mean([one["in_time"] for one in told["raised"]])
            print(
                f"{name}: {latency['scans']} scans, {latency['median']} ms median, {latency['p95']} ms at the 95th "
                f"percentile, {latency['largest']} ms at most; {told['rate']:.2f} frames/s of {options.rate}; "
                f"{1e3 * told['processor_s'] / latency['scans']:.0f} ms of processor time per scan, start included; "
                f"{counts['masked']} scans masked; {told['alarms']} alarms, raised {left:.1f} m ahead (median), "
                f"{in_time:.2f} of them in time at 15 km/h; load {os.getloadavg()[0]:.1f}, "
                f"{time.perf_counter() - start:.0f} s in all",
                flush=True,
            )
            if options.agreement:
                classifier = None if chosen is None else load_model(chosen).detector
                batch = detect(dataset, load_recipe("wang2007"), lane, model=classifier).alarms
                print(f"  {agreement(told['alarms_table'], batch)}", flush=True)


if __name__ == "__main__":
    main()
