"""What earlier drives over the same road are worth: mines laid since, found with them and without.

``python evidence/two_drives.py OUT [--conditions NAME ...]`` simulates the drives that ``two_drives.toml`` declares,
runs the detectors on the last ones and prints how many of the mines laid since the one before each finds. What is there
is kept.
"""

from __future__ import annotations

import argparse
import math
import shutil
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from common import CONTRAST_RECIPE, alone, markdown, with_share
from flgpr import detect
from flgpr.jobs.simulated_lane import simulate_to_store
from flgpr.live.feeding import feed
from flgpr.live.options import LiveOptions
from flgpr.live.session import LiveRun
from flgpr.model import Lane, Sensor, load_sensor
from flgpr.recipe.make import with_earlier
from flgpr.scoring import match, side_by_side
from flgpr.simulate import Scene, draw_world
from flgpr.store import lane_text, read_table

DECLARED = tomllib.loads(Path(__file__).with_suffix(".toml").read_text("utf-8"))


def roads() -> Iterator[tuple[str, str, int]]:
    """Yield name, site and seed of every road."""
    for site in DECLARED["sites"]:
        for seed in DECLARED["seeds"]:
            yield f"{site}-{seed}", site, seed


def scene_of(site: str, change: dict[str, float]) -> Scene:
    """Return the scene of a site that has changed at its third drive."""
    drives = [DECLARED["first"], change]
    return Scene.model_validate(
        DECLARED["scene"] | {"site": site, "name": "road", "drives": drives}
    )


def sensor() -> Sensor:
    """Return the radar, with the first drive's poses."""
    entries = load_sensor("sri-array").model_dump()
    entries |= {"tones": DECLARED["tones"], "polarization": DECLARED["polarization"]}
    entries["errors"] |= DECLARED["first"]
    return Sensor.model_validate(entries)


def driven(folder: Path, scene: Scene, seed: int) -> Path:
    """Return the run of a drive, simulated if it is not there."""
    run = folder / "run.zarr"
    if not (folder / "done").is_file():
        folder.mkdir(parents=True, exist_ok=True)
        simulate_to_store(scene, sensor(), seed, run)
        (folder / "done").touch()
    return run


def alarms_of(out: Path, road: tuple[str, str, int], condition: str) -> dict[str, pd.DataFrame]:
    """Return the alarms of every detector on the third drive over a road."""
    name, site, seed = road
    scene = scene_of(site, DECLARED["conditions"][condition])
    home = out / name / condition.replace(" ", "-")
    found = {}
    for detector, entries in DECLARED["detectors"].items():
        result = home / f"result-{detector.replace(', ', '-').replace(' ', '-')}"
        if not (result / "alarms.csv").is_file():
            run = driven(home, scene.at_drive(3), seed)
            before = earlier_drives(out, road, condition)[: entries["drives"] - 1]
            detect_as(entries, run, before, lane_of(scene), result)
        found[detector] = read_table(result / "alarms.csv", "alarms").assign(lane=name)
    return found


def earlier_drives(out: Path, road: tuple[str, str, int], condition: str) -> list[Path]:
    """Return the runs of the earlier drives over a road, the latest first."""
    name, site, seed = road
    nothing = scene_of(site, DECLARED["first"])
    earlier = [
        driven(out / name / f"drive-{drive}", nothing.at_drive(drive), seed) for drive in (2, 1)
    ]
    other = DECLARED["control"].get(condition)
    if other:
        then = scene_of(site, DECLARED["conditions"][other])
        earlier[0] = driven(out / name / other.replace(" ", "-"), then.at_drive(3), seed)
    return earlier


def detect_as(
    entries: dict[str, Any], run: Path, before: list[Path], lane: Lane, result: Path
) -> None:
    """Run a detector on a drive, with what it is given of earlier ones."""
    if entries.get("made"):
        detect(run, output=result, report=False, before=before, lane=lane)
        return
    text = CONTRAST_RECIPE.format(near=7.0, frames=1, **entries)
    if before:
        text = f"{with_earlier(text)}{entries['earlier']}\n"
    recipe = result.with_suffix(".toml")
    recipe.write_text(text, "utf-8")
    if entries.get("live"):
        detect_live(run, recipe, before, lane, result)
    else:
        detect(run, recipe=recipe, output=result, report=False, before=before)


def detect_live(run: Path, recipe: Path, before: list[Path], lane: Lane, output: Path) -> None:
    """Detect on a stored run as if it came scan by scan."""
    incoming, lane_file = output.with_name("incoming"), output.with_name("lane.toml")
    shutil.rmtree(incoming, ignore_errors=True)
    incoming.mkdir()
    lane_file.write_text(lane_text(lane), "utf-8")
    feed(run, incoming, math.inf)
    LiveRun(LiveOptions(recipe, output, incoming, lane=lane_file, before=before, fresh=True)).run()
    shutil.rmtree(incoming)


def lane_of(scene: Scene) -> Lane:
    """Return the road of a scene."""
    return Lane(scene.x_min, scene.x_max, 0.0, scene.length)


def rows_of(out: Path, condition: str) -> Iterator[list[object]]:
    """Yield what each detector finds of the mines laid since, over all roads."""
    detectors = list(DECLARED["detectors"])
    lists: dict[str, list[pd.DataFrame]] = {detector: [] for detector in detectors}
    truths, lanes, decoys = [], {}, []
    for road in roads():
        for detector, alarms in alarms_of(out, road, condition).items():
            lists[detector].append(alarms)
        scene = scene_of(road[1], DECLARED["conditions"][condition]).at_drive(3)
        world = draw_world(scene, road[2])
        truths.append(world.truth().assign(lane=road[0]))
        dug = [hole for hole in world.holes if hole.target is None]
        of_before = draw_world(scene_of(road[1], DECLARED["first"]), road[2]).holes
        old = {(hole.x, hole.y) for hole in of_before}
        decoys += [(road[0], hole.x, hole.y) for hole in dug if (hole.x, hole.y) not in old]
        lanes[road[0]] = lane_of(scene)
    truth = pd.concat(truths, ignore_index=True)
    matches = {}
    for detector in detectors:
        alarms = pd.concat(lists[detector], ignore_index=True)
        old_mines = truth[truth["laid"] == 1]
        kept = alarms[~near(alarms, old_mines, DECLARED["halo"])]
        laid = truth[truth["laid"] == 3].reset_index(drop=True)
        matches[detector] = match(kept.reset_index(drop=True), laid, lanes, DECLARED["halo"])
    compared = side_by_side(matches, DECLARED["fars"], means=False)
    points = compared.points.set_index(["detector", "far_allowed"])
    for detector in detectors:
        row: list[object] = [condition, detector]
        for far in DECLARED["fars"]:
            point = points.loc[(detector, far)]
            row.append(with_share(int(point["n_detected"]), int(point["n_targets"])))
        places = pd.DataFrame(decoys, columns=["lane", "x", "y"])
        yield [
            *row,
            against(compared.pairs, detector),
            raised(matches[detector], places),
        ]


def near(alarms: pd.DataFrame, places: pd.DataFrame, halo: float) -> np.ndarray:
    """Return which alarms lie within a halo of places of their lane."""
    found = np.zeros(len(alarms), bool)
    for _, place in places.iterrows():
        away = np.hypot(alarms["x"] - place["x"], alarms["y"] - place["y"])
        found |= ((away <= halo) & (alarms["lane"] == place["lane"])).to_numpy()
    return found


def against(pairs: pd.DataFrame, detector: str) -> str:
    """Return what a detector and its rival each find alone at 0.02 per m², and McNemar's p."""
    rival = DECLARED["detectors"][detector].get("against")
    if rival not in DECLARED["detectors"]:
        return ""
    own, its, chance = alone(pairs, 0.02, detector, rival)
    return f"{rival}: +{own} -{its}, p = {chance:.2g}"


def raised(matched: Any, decoys: pd.DataFrame) -> str:
    """Return how many decoys have an alarm above the threshold at 0.02 per m² that they do not set."""
    if decoys.empty:
        return ""
    false = matched.alarms[~near(matched.alarms, matched.truth, matched.halo)]
    own = near(false, decoys, matched.halo)
    area = sum(lane.area for lane in matched.lanes.values())
    threshold = np.sort(false.loc[~own, "confidence"])[::-1][int(0.02 * area)]
    strong = false[own & (false["confidence"] > threshold)]
    return f"{int(near(decoys.assign(confidence=0), strong, matched.halo).sum())} of {len(decoys)}"


def main() -> None:
    """Run the conditions and print what is found."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("--conditions", nargs="*", default=list(DECLARED["conditions"]))
    parser.add_argument("--detectors", nargs="*", choices=list(DECLARED["detectors"]))
    given = parser.parse_args()
    if given.detectors:
        DECLARED["detectors"] = {name: DECLARED["detectors"][name] for name in given.detectors}
    heads = ["today", "detector", *(f"at {far:g} per m²" for far in DECLARED["fars"])]
    heads += ["against, at 0.02", "decoys raised"]
    for condition in given.conditions:
        print(markdown(heads, list(rows_of(given.out, condition))), flush=True)


if __name__ == "__main__":
    main()
