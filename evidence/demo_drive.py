"""Record the drive that `flgpr demo --live` plays: simulate, train, detect live, and keep the events.

Three lanes are drawn of one scene with one array: two to train the recipe on, and a third one that the detector
drives along. Scene, array and recipe lie beside the recording. Every scan is handed over when the one before it is
done with, so that the latencies are those of this machine and nothing queues. Usage::

    python evidence/demo_drive.py WORK_FOLDER

Prints how many of the mines were raised, how far ahead, and the false alarms. The run-view is kept in steps of
0.25 dB, which the picture does not show; everything else is as `flgpr live` wrote it.
"""

from __future__ import annotations

import argparse
import base64
import gzip
import json
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from flgpr.commands.simulate import simulate_lane
from flgpr.commands.train import train
from flgpr.live.detector import LiveSettings
from flgpr.live.feeding import feed
from flgpr.live.options import LiveOptions
from flgpr.live.session import LiveRun
from flgpr.model.vehicle import Vehicle
from flgpr.store import read_table, sample_drive

TRAINING_SEEDS = (1, 2)
DRIVE_SEED = 3
SPEED = 15 / 3.6  # m/s
SHOWN_FROM = float(np.log(0.2 / 0.8))  # log odds of an alarm that the driver's screen shows
PICTURE_STEP = 0.25  # dB
NEAR = 1.0  # m, halo of the recipe
LEAD = 20.0  # s that detection has to load
MOST_PATIENCE = 10.0  # s for a scan, which may have been left out


def make_lane(folder: Path, name: str, seed: int) -> Path:
    """Simulate a lane, unless an earlier run of this script did."""
    run = folder / f"{name}.zarr"
    if not run.exists():
        sample = sample_drive()
        simulate_lane(
            sample / "scene.toml", sensor=str(sample / "sensor.toml"), seed=seed, output=run
        )
    return run


def make_model(folder: Path) -> Path:
    """Train the recipe on the lanes for it."""
    lanes = []
    for number, seed in enumerate(TRAINING_SEEDS, 1):
        lanes.append(make_lane(folder, f"training-{number}", seed))
    truths = [lane.with_name(f"{lane.stem}-truth.csv") for lane in lanes]
    areas = [lane.with_name(f"{lane.stem}-lane.toml") for lane in lanes]
    model = folder / "model"
    train(lanes, truths, sample_drive() / "recipe.toml", model, lanes=areas, overwrite=False)
    return model


def detect_live(run: Path, model: Path, output: Path) -> list[dict[str, Any]]:
    """Return the events of live detection on a run whose scans are handed over one by one."""
    incoming = output.with_name(f"{output.name}-incoming")
    vehicle = Vehicle(speed=SPEED, front=0.5, threshold=SHOWN_FROM)
    options = LiveOptions(
        sample_drive() / "recipe.toml",
        output,
        incoming,
        model=model,
        lane=run.with_name(f"{run.stem}-lane.toml"),
        settings=LiveSettings(),
        vehicle=vehicle,
        fresh=True,
    )
    events_file = output / "live.jsonl"
    live = LiveRun(options)
    detection = threading.Thread(target=live.run)
    detection.start()
    handed_over = 0

    def wait_for_the_last(lead: float) -> None:
        nonlocal handed_over
        if not handed_over:  # before the first scan: detection loads and compiles
            time.sleep(lead)
        deadline = time.monotonic() + MOST_PATIENCE
        while _scans_in(events_file) < handed_over and time.monotonic() < deadline:
            time.sleep(0.02)
        handed_over += 1

    # A rate that no waiting is as slow as: what is waited for sets the pace.
    feed(run, incoming, rate=1e-6, lead=LEAD, wait=wait_for_the_last)
    detection.join()
    return [json.loads(line) for line in events_file.read_text().splitlines()]


def _scans_in(path: Path) -> int:
    """Return how many scans the file of events holds."""
    return path.read_text().count('"event":"scan"') if path.is_file() else 0


def with_coarse_picture(event: dict[str, Any]) -> dict[str, Any]:
    """Return an event whose rows of the run-view are rounded: half the bytes when compressed."""
    if event["event"] != "view":
        return event
    values = np.frombuffer(base64.b64decode(event["halves"]), "<f2").astype(np.float32)
    rounded = PICTURE_STEP * np.round(values / PICTURE_STEP)
    halves = base64.b64encode(rounded.astype("<f2").tobytes()).decode()
    return event | {"halves": halves}


def write_recording(events: list[dict[str, Any]], path: Path) -> None:
    """Write the events as compressed lines, the same bytes for the same events."""
    lines = []
    for event in events:
        lines.append(json.dumps(with_coarse_picture(event), separators=(",", ":")) + "\n")
    path.write_bytes(gzip.compress("".join(lines).encode(), 9, mtime=0))


def summarise(events: list[dict[str, Any]], truth: pd.DataFrame) -> None:
    """Print what became of every mine, and how many other alarms were shown."""
    alarms = pd.DataFrame([event for event in events if event["event"] == "alarm"])
    shown = alarms[(alarms["state"] != "withdrawn") & (alarms["confidence"] >= SHOWN_FROM)]
    is_hit = np.zeros(len(shown), bool)
    for mine in truth.to_dict("records"):
        near = np.hypot(shown["x"] - mine["x"], shown["y"] - mine["y"]) <= NEAR
        is_hit |= np.asarray(near)
        ahead = shown[near & (shown["left_m"] > 0)]
        if ahead.empty:
            print(f"{mine['target_id']}: not raised")
            continue
        first = ahead.iloc[0]
        last = ahead.iloc[-1]
        print(
            f"{mine['target_id']}: raised {first['left_m']:.1f} m ahead with p {first['p']:.2f}, "
            f"p {last['p']:.2f} at {last['left_m']:.1f} m"
        )
    others = shown[~is_hit]["alarm_id"].nunique()
    latencies = [event["latency_ms"] for event in events if event["event"] == "scan"]
    print(f"{others} other alarms were shown; latency {np.median(latencies):.0f} ms (median)")


def main() -> None:
    """Make the recording."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("work", type=Path, help="folder for lanes, model and the live run")
    folder = parser.parse_args().work
    folder.mkdir(parents=True, exist_ok=True)
    model = make_model(folder)
    run = make_lane(folder, "drive", DRIVE_SEED)
    events = detect_live(run, model, folder / "live")
    write_recording(events, sample_drive() / "drive.jsonl.gz")
    truth = read_table(folder / "drive-truth.csv", "truth")
    truth.to_csv(sample_drive() / "truth.csv", index=False)
    summarise(events, truth)


if __name__ == "__main__":
    main()
