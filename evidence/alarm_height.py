"""How well the height of what raises an alarm is told, on the roads that ``alarm_height.toml`` declares.

``python evidence/alarm_height.py OUT`` simulates the roads, detects under every condition, and writes ``alarms.csv``,
every alarm with what it belongs to and the true height, ``alarm-heights.csv``, what is told of each kind of thing, and
``alarm-height-claims.csv``. Runs and alarms that are there are kept.
"""

from __future__ import annotations

import argparse
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from common import CONTRAST_RECIPE, each_of, simulated, with_share
from flgpr import detect
from flgpr.calibrate import focus_poses
from flgpr.clutter import subtract_mean_scan
from flgpr.imaging import ImagingOperator
from flgpr.method.method import detect as detect_in_memory
from flgpr.model import Lane
from flgpr.recipe.schema import parse_recipe
from flgpr.simulate import Scene
from flgpr.simulate.ground.roughness import surface_heights
from flgpr.simulate.ground.terrain import TerrainHeights
from flgpr.simulate.scene.draw import stream
from flgpr.store import open_run, read_table, save_run, write_table
from full_wave_lanes import array_of, decks_of, run_of
from full_wave_lanes import declared as lanes_declared
from pose_focus import sensor, with_pose, wrong_poses

DECLARED: dict[str, Any] = tomllib.loads(Path(__file__).with_suffix(".toml").read_text("utf-8"))
GROUND = 0.15  # m, the stage's default
SHOWN = ("exact", "1 cm, focused")


def scene_of(site: str, step: list[float]) -> Scene:
    """Return the road of a site, its things in random order, with a scan every so many metres."""
    rng = stream(DECLARED["seed"], f"things {site}")
    declared = DECLARED["things"].items()
    things = [(sort, thing) for sort, listed in declared for thing in each_of(listed)]
    placed: dict[str, list[dict[str, Any]]] = {"mines": [], "objects": []}
    for place, number in enumerate(rng.permutation(len(things))):
        sort, thing = things[number]
        y = DECLARED["first"] + place * DECLARED["every"]
        placed[sort].append({**thing, "x": rng.uniform(-1.0, 1.0), "y": y})
    length = DECLARED["first"] + len(things) * DECLARED["every"] + DECLARED["end"]
    track = {"step": step, "wander": 0.1, "attitude": 0.004, "bounce": 0.005}
    entries = {"targets": placed["mines"], "objects": placed["objects"], "track": track}
    return Scene.model_validate({"site": site, "name": "road", "length": length} | entries)


def things_of(scene: Scene) -> pd.DataFrame:
    """Return what lies in the lane by intention: ``thing``, ``x``, ``y``, ``height`` and ``depth``."""
    rows: list[dict[str, Any]] = []
    for one in (*scene.targets, *scene.objects):
        depth = getattr(one, "depth", 0.0)
        height = one.height if one.kind in ("bush", "fiducial") else 0.0
        rows.append({"thing": one.kind, "x": one.x, "y": one.y, "height": height, "depth": depth})
    return pd.DataFrame(rows)


def ground_height(scene: Scene, places: np.ndarray) -> np.ndarray:
    """Return the height (place,) of the surface at places (place, 2), averaged over 0.4 m."""
    terrain = TerrainHeights(scene.terrain, scene.lane, DECLARED["seed"])
    rough = surface_heights(scene.surface, DECLARED["seed"])
    side = np.linspace(-0.2, 0.2, 7)
    x = places[:, 0, None, None] + side
    y = places[:, 1, None, None] + side[:, None]
    return np.asarray((terrain(x, y) + rough(x, y)).mean(axis=(1, 2)))


def road(out: Path, site: str, kind: str) -> Path:
    """Return the run of a site with exact poses, simulated if it is not there."""
    scene = scene_of(site, DECLARED[kind])
    return simulated(scene, sensor(), DECLARED["seed"], out / site / kind / "exact.zarr")


def posed(out: Path, site: str, condition: str) -> Path:
    """Return the run of a site with the poses of a condition."""
    exact = road(out, site, "step")
    run = exact.with_name(f"{condition.replace(' ', '-')}.zarr")
    if not run.is_dir():
        measured = open_run(exact).compute()
        errors = DECLARED["conditions"][condition]
        pose = wrong_poses(measured["pose"].values, errors, site, condition.split(",")[0])
        if condition.endswith("focused"):
            still = subtract_mean_scan(with_pose(measured, pose))
            pose = focus_poses(still, ImagingOperator).pose
        save_run(with_pose(measured, pose), run)
    return run


def alarms_of(run: Path, scene: Scene) -> pd.DataFrame:
    """Return the alarms of a run with what each belongs to, ``thing``, and its true height."""
    result = run.with_name(f"result-{run.stem}")
    if not (result / "alarms.csv").is_file():
        recipe = run.with_name("recipe.toml")
        entries = {"near": DECLARED["near"], "channel": "HH", "band": DECLARED["band"], "frames": 1}
        text = CONTRAST_RECIPE.format(**entries) + '\n[[columns]]\nstage = "height"\n'
        recipe.write_text(text, "utf-8")
        lane = Lane(scene.x_min, scene.x_max, 0.0, scene.length)
        detect(run, recipe=recipe, output=result, report=False, lane=lane)
    alarms = read_table(result / "alarms.csv", "alarms")
    things = things_of(scene)
    places = alarms[["x", "y"]].to_numpy(dtype=float)
    away = np.linalg.norm(places[:, None] - things[["x", "y"]].to_numpy(), axis=-1)
    nearest, distance = away.argmin(axis=1), away.min(axis=1)
    alarms["number"] = np.where(distance <= DECLARED["halo"], nearest, -1)
    own = things.iloc[nearest].reset_index(drop=True)
    is_thing = alarms["number"] >= 0
    alarms["thing"] = own["thing"].where(is_thing, "ground")
    alarms["depth"] = own["depth"].where(is_thing, np.nan)
    alarms["stands"] = own["height"].where(is_thing, 0.0)
    alarms["true"] = alarms["stands"] + ground_height(scene, places)
    first = ~alarms["number"].duplicated()  # the most confident of a thing's alarms
    return alarms[np.where(is_thing, first, distance >= DECLARED["clear"])]


def collected(out: Path) -> pd.DataFrame:
    """Return the alarms of all roads under all conditions."""
    tables = []
    for site in DECLARED["sites"]:
        runs = {}
        for condition in DECLARED["conditions"]:
            exact = condition == "exact"
            runs[condition] = road(out, site, "step") if exact else posed(out, site, condition)
        runs["dense"] = road(out, site, "dense")
        for condition, run in runs.items():
            scene = scene_of(site, DECLARED["dense" if condition == "dense" else "step"])
            tables.append(alarms_of(run, scene).assign(site=site, poses=condition))
            print(site, condition, len(tables[-1]), flush=True)
    return pd.concat(tables, ignore_index=True)


def kind_of(alarm: pd.DataFrame) -> pd.Series:
    """Return the kind of thing that alarms belong to, as the table names it."""
    reflector = "reflector at " + alarm["stands"].map("{:.1f} m".format)
    mines = alarm["thing"].isin(["metal", "plastic"])
    return alarm["thing"].where(~mines, "mine").where(alarm["thing"] != "fiducial", reflector)


def above(some: pd.DataFrame) -> str:
    """Return how many alarms are said to stand above the ground."""
    return with_share(int((some["height_low"] > GROUND).sum()), len(some))


def held(some: pd.DataFrame) -> str:
    """Return of how many alarms the interval holds the true height."""
    inside = some["true"].between(some["height_low"], some["height_high"])
    return with_share(int(inside.sum()), len(some))


def told(alarms: pd.DataFrame) -> pd.DataFrame:
    """Return what is told of each kind of thing with exact and with focused poses, as text."""
    rows = []
    for kind, some in alarms.groupby(kind_of(alarms)):
        row = {"thing": kind}
        for poses in SHOWN:
            of_poses = some[some["poses"] == poses]
            error = of_poses["height"] - of_poses["true"]
            row[f"{poses}: error, m"] = (
                f"{error.std():.2f} about {error.median().round(2) + 0.0:+.2f}"
            )
            row[f"{poses}: interval holds it"] = held(of_poses)
            row[f"{poses}: said to stand above"] = above(of_poses)
            if kind == "bush":  # it has twigs at all heights
                row[f"{poses}: error, m"] = row[f"{poses}: interval holds it"] = "·"
        rows.append(row)
    return pd.DataFrame(rows)


def claims(alarms: pd.DataFrame) -> pd.DataFrame:
    """Return the figures that the claims are about, under every condition, as text."""
    kind = kind_of(alarms)
    reflector = kind.str.startswith("reflector")
    high = (reflector & (alarms["stands"] >= 0.4)) | (kind == "bush")
    rows = []
    for poses, index in alarms.groupby("poses", sort=False).groups.items():
        some = alarms.loc[index]
        row = {"poses": poses}
        row["interval holds the height, reflectors"] = held(some[reflector[index]])
        row["the same, ground"] = held(some[kind[index] == "ground"])
        row["reflectors from 0.4 m on, and bushes, said to stand above"] = above(some[high[index]])
        row["ground and mines said to"] = above(some[kind[index].isin(["ground", "mine"])])
        width = some["height_high"] - some["height_low"]
        row["median interval, m"] = f"{width.median():.2f}"
        rows.append(row)
    return pd.DataFrame(rows)


def draw(alarms: pd.DataFrame, path: Path) -> None:
    """Draw what is told of every alarm with focused poses, by the kind of thing it belongs to."""
    some = alarms[(alarms["poses"] == "1 cm, focused") & alarms["height"].notna()]
    kinds = kind_of(some)
    order = ["ground", "mine", "rock", *sorted(set(kinds) - {"ground", "mine", "rock"})]
    figure = Figure(figsize=(9.6, 4.2), layout="constrained")
    axes = figure.subplots()
    begin = 0.0
    interval, height, true = "90 % interval", "height that is told", "true height"
    for kind in (kind for kind in order if (kinds == kind).any()):
        of_kind = some[kinds == kind].sort_values("height")
        x = begin + np.arange(len(of_kind)) * (0.25 if kind == "ground" else 1.6)
        low, high = (of_kind[f"height_{end}"] for end in ("low", "high"))
        axes.vlines(x, low, high, color="0.6", linewidth=1, label=interval)
        axes.plot(x, of_kind["height"], ".", markersize=5, color="C0", label=height)
        if kind != "bush":
            axes.plot(x, of_kind["true"], "_", markersize=5, color="C3", label=true)
        interval, height, true = "", "", ""  # once in the legend
        label = kind.removeprefix("reflector at ")
        axes.annotate(label, (x.mean(), 1.28), ha="center", fontsize=9)
        begin = x[-1] + 6
        if kind == order[-3]:  # in the middle of the reflectors
            axes.annotate("reflectors at", (x.mean(), 1.37), ha="center", fontsize=9)
    axes.axhline(GROUND, color="0.3", linewidth=0.8, linestyle=":")
    axes.legend(loc="lower right", fontsize=8)
    axes.set(xticks=[], ylim=(-0.4, 1.5), ylabel="height, m")
    figure.savefig(path, dpi=90, metadata={"Software": None})


def on_full_wave() -> pd.DataFrame:
    """Return the alarms on the drive that gprMax computed, on which all things lie on the ground."""
    common = lanes_declared(Path(__file__).with_name("pose_full_wave.toml"))
    (lane,) = common["lanes"]
    run = run_of(lane, decks_of(common, lane, array_of(common)).manifest)
    entries = {"near": 0.75, "channel": "VV", "band": [0.45e9, 1.5e9], "frames": 1}
    text = (
        CONTRAST_RECIPE.format(**entries)
        .replace("16.0", "6.5")
        .replace('"mean"\nmed', '"none"\nmed')
    )
    text += '\n[[columns]]\nstage = "height"\nspan = [-0.3, 0.5]\nreach = 0.15\n'
    return detect_in_memory(run, parse_recipe(text), Lane(-1.0, 1.0, 1.2, 5.2)).alarms


def main() -> None:
    """Make the roads, detect, and write the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("--figure", type=Path, help="PNG of all heights with focused poses")
    given = parser.parse_args()
    alarms = collected(given.out)
    write_table(alarms, given.out / "alarms.csv")
    known = alarms[alarms["height"].notna()]
    for name, table in {"alarm-heights": told(known), "alarm-height-claims": claims(known)}.items():
        write_table(table, given.out / f"{name}.csv")
        print(table.to_string())
    print(f"alarms without a height: {len(alarms) - len(known)} of {len(alarms)}")
    wave = on_full_wave().dropna()
    within = (wave["height_low"] <= 0.0) & (wave["height_high"] >= 0.0)
    print(f"gprMax: {within.sum()} of {len(wave)} intervals hold the ground", wave, sep="\n")
    if given.figure:
        draw(alarms, given.figure)


if __name__ == "__main__":
    main()
