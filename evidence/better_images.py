"""Tell what images with lower side lobes could still find, on the roads that ``better_images.toml`` declares.

``python evidence/better_images.py OUT`` simulates the roads, detects, and writes ``better-images-SEED.csv``: mines
found in the open, beside bright things, with these fitted and subtracted, and with tones missing, ranked by contrast
and by magnitude. Runs that are there are kept.
"""

from __future__ import annotations

import argparse
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from common import CONTRAST_RECIPE, alone, each_of, simulated, with_share
from flgpr.method.method import detect
from flgpr.model import Lane
from flgpr.recipe.schema import parse_recipe
from flgpr.scoring import match, side_by_side
from flgpr.simulate import Scene, draw_world
from flgpr.simulate.scene.draw import stream
from flgpr.store import open_run, write_table
from pose_focus import sensor

DECLARED: dict[str, Any] = tomllib.loads(Path(__file__).with_suffix(".toml").read_text("utf-8"))
CONDITIONS = {  # road, tones missing, bright things fitted, what ranks
    "contrast, in the open": ("open", False, False, "contrast"),
    "contrast, beside bright things": ("bright", False, False, "contrast"),
    "contrast, these fitted": ("bright", False, True, "contrast"),
    "contrast, in the open, a fifth of the tones missing": ("open", True, False, "contrast"),
    "magnitude, bright things fitted, in the open": ("open", False, True, "magnitude"),
    "magnitude, beside bright things": ("bright", False, False, "magnitude"),
    "magnitude, these fitted": ("bright", False, True, "magnitude"),
}
RIVALS = {name: "contrast, in the open" for name in CONDITIONS} | {
    "magnitude, beside bright things": "contrast, beside bright things",
    "magnitude, these fitted": "contrast, beside bright things",
}


def scene_of(site: str, seed: int, bright: bool) -> Scene:
    """Return the road of a site, in the open or with a bright thing beside every mine."""
    rng = stream(seed, f"places {site}")
    sorts = each_of(DECLARED["mines"])
    mines, things = [], []
    for place, number in enumerate(rng.permutation(len(sorts))):
        x, y = rng.uniform(-1.0, 1.0), DECLARED["first"] + place * DECLARED["every"]
        mines.append({**sorts[number], "x": x, "y": y})
        thing = DECLARED["bright"][place % len(DECLARED["bright"])]
        beside = np.copysign(rng.uniform(1.7, 2.4), x)
        things.append({**thing, "x": beside, "y": y + rng.uniform(-1.5, 1.5)})
    entries = {"name": "road", "site": site, "track": DECLARED["track"], "targets": mines}
    entries["objects"] = things if bright else []
    entries["length"] = mines[-1]["y"] + DECLARED["end"]
    return Scene.model_validate(entries)


def road(out: Path, site: str, seed: int, kind: str) -> xr.Dataset:
    """Return the run of a road, "open" or "bright", simulated if it is not there."""
    scene = scene_of(site, seed, kind == "bright")
    run = simulated(scene, sensor(), seed, out / str(seed) / site / kind / "run.zarr")
    return open_run(run).compute()


def with_gaps(run: xr.Dataset) -> xr.Dataset:
    """Return a run without some tones of the band, in gaps of equal width, evenly spread over it."""
    tones = run["frequency"].values
    low, high = DECLARED["band"]
    place = (tones - low) / (high - low) * DECLARED["gaps"]
    in_gap = np.abs(place % 1 - 0.5) < DECLARED["share"] / 2
    return run.isel(frequency=np.flatnonzero(~(in_gap & (place > 0) & (place < DECLARED["gaps"]))))


def found(out: Path, seed: int) -> pd.DataFrame:
    """Return how many mines are found on the roads of a seed under every condition, as text."""
    entries = {"near": DECLARED["near"], "channel": "HH", "band": DECLARED["band"], "frames": 1}
    plain = CONTRAST_RECIPE.format(**entries)
    lists: dict[str, list[pd.DataFrame]] = {condition: [] for condition in CONDITIONS}
    truths, lanes = [], {}
    for site in DECLARED["sites"]:
        scene = scene_of(site, seed, bright=False)
        lanes[site] = Lane(scene.x_min, scene.x_max, 0.0, scene.length)
        truths.append(draw_world(scene, seed).truth().assign(lane=site))
        runs = {kind: road(out, site, seed, kind) for kind in ("open", "bright")}
        for condition, (kind, gaps, fitted, ranks) in CONDITIONS.items():
            run = with_gaps(runs[kind]) if gaps else runs[kind]
            text = f'confidence = "{ranks}"\n' + plain + (DECLARED["roadside"] if fitted else "")
            alarms = detect(run, parse_recipe(text), lanes[site]).alarms
            lists[condition].append(alarms.assign(lane=site))
            print(seed, site, condition, len(alarms), flush=True)
    truth = pd.concat(truths, ignore_index=True)
    matches = {}
    for condition, alarms in lists.items():
        table = pd.concat(alarms, ignore_index=True)
        matches[condition] = match(table, truth, lanes, DECLARED["halo"])
    compared = side_by_side(matches, DECLARED["fars"], means=False)
    points = compared.points.set_index(["detector", "far_allowed"])
    rows = []
    for condition, rival in RIVALS.items():
        row: dict[str, object] = {"ranked by": condition}
        for far in DECLARED["fars"]:
            point = points.loc[(condition, far)]
            row[f"at {far:g} per m²"] = with_share(
                int(point["n_detected"]), int(point["n_targets"])
            )
        if condition != rival:
            own, its, chance = alone(compared.pairs, DECLARED["fars"][-1], condition, rival)
            row["against"] = rival
            row[f"alone, at {DECLARED['fars'][-1]:g}"] = f"{own} and {its}, p = {chance:.2g}"
        rows.append(row)
    return pd.DataFrame(rows).fillna("·")


def main() -> None:
    """Make the roads, detect, and write the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out", type=Path)
    out = parser.parse_args().out
    for seed in DECLARED["seeds"]:
        table = found(out, seed)
        write_table(table, out / f"better-images-{seed}.csv")
        print(table.to_string())


if __name__ == "__main__":
    main()
