"""What poses that focus themselves are worth: loss of coherent sums and mines found, with wrong poses and focused ones.

``python evidence/pose_focus.py OUT`` simulates the roads that ``pose_focus.toml`` declares, focuses their poses under
every condition, and writes ``errors.csv`` and ``mines.csv`` in OUT, and of them ``pose-errors.csv``, means over the
roads, and ``pose-mines.csv``, at the first rate. Runs and results that are there are kept.
"""

from __future__ import annotations

import argparse
import math
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from matplotlib.figure import Figure

from common import CONTRAST_RECIPE, alone, simulated, with_share
from flgpr import detect
from flgpr.calibrate import focus_poses
from flgpr.clutter import subtract_mean_scan
from flgpr.imaging import ImagingOperator
from flgpr.model import Lane, Sensor, load_sensor
from flgpr.model.aperture import antennas_in_lane
from flgpr.scoring import match, side_by_side
from flgpr.simulate import Scene, draw_world
from flgpr.simulate.scene.draw import stream
from flgpr.store import open_run, read_table, save_run, write_table

DECLARED = tomllib.loads(Path(__file__).with_suffix(".toml").read_text("utf-8"))
POSES = ("wrong", "focused", "exact")


def scene_of(site: str) -> Scene:
    """Return the road of a site."""
    return Scene.model_validate(DECLARED["scene"] | {"site": site, "name": "road"})


def sensor() -> Sensor:
    """Return the radar, whose poses are exact."""
    entries = load_sensor("sri-array").model_dump()
    entries |= {"tones": DECLARED["tones"], "polarization": DECLARED["polarization"]}
    entries["errors"] |= {"position": 0.0, "heading": 0.0, "attitude": 0.0}
    return Sensor.model_validate(entries)


def road(out: Path, site: str) -> Path:
    """Return the run of a site with exact poses, simulated if it is not there."""
    return simulated(scene_of(site), sensor(), DECLARED["seed"], out / site / "exact.zarr")


def wrong_poses(
    pose: np.ndarray, errors: dict[str, float], site: str, condition: str
) -> np.ndarray:
    """Return poses (scan, 6) with the errors of a condition."""
    rng = stream(DECLARED["seed"], f"poses {site} {condition}")
    wrong = pose.copy()
    wrong[:, :3] += errors.get("position", 0.0) * rng.normal(size=(len(pose), 3))
    wrong[:, 3:] += math.radians(errors.get("turn", 0.0)) * rng.normal(size=(len(pose), 3))
    knots = rng.normal(size=(len(pose) // 6 + 2, 3))
    for axis in range(3):
        drift = np.interp(np.arange(len(pose)) / 6, np.arange(len(knots)), knots[:, axis])
        wrong[:, axis] += errors.get("drift", 0.0) * drift
    return wrong


def with_pose(run: xr.Dataset, pose: np.ndarray) -> xr.Dataset:
    """Return a run with other poses."""
    return run.assign(pose=(run["pose"].dims, pose))


def against_next(error: np.ndarray, sight: np.ndarray) -> float:
    """Return errors (scan, 3) along the line of sight against the next scan's, of one scan, m."""
    return float(np.std(np.diff(error @ sight)) / math.sqrt(2))


def sum_around(run: xr.Dataset, mine: np.ndarray, half: float) -> np.ndarray:
    """Return the sum (y, x) of all looks on a square around a mine, dB."""
    tones, place = run["frequency"].values, run["pose"].values
    side = np.arange(-half, half + 0.001, 0.05)
    patch = np.stack([*np.meshgrid(side, side), np.zeros((side.size, side.size))], axis=-1)
    ahead = mine[1] - place[:, 1]
    near, far = DECLARED["looks"]
    looks = np.flatnonzero((ahead >= near) & (ahead <= far))
    data = np.nan_to_num(run["signal"][looks].sel(polarization=["HH"]).values)
    total = np.zeros(patch.shape[:2], complex)
    for scan, sweeps in zip(looks, data, strict=True):
        tx, rx = antennas_in_lane(run, place[scan : scan + 1])
        points = patch + [*mine, 0.0]
        imaging = ImagingOperator(tones, tx, rx, points, [(0.45e9, 1.6e9)], window="hann")
        total += imaging.adjoint(sweeps)[0, 0]
    return 20 * np.log10(np.abs(total))


def sums_at_mines(run: xr.Dataset, mines: pd.DataFrame) -> np.ndarray:
    """Return the greatest power of the sum of all looks at each mine, dB."""
    places = mines[["x", "y"]].to_numpy()
    return np.array([sum_around(run, mine, 0.3).max() for mine in places])


def draw(out: Path, path: Path) -> None:
    """Draw the sums around the first metal mine of a road with the greatest errors, by all poses."""
    site, condition = DECLARED["sites"][-1], "3 cm"
    exact = subtract_mean_scan(open_run(road(out, site)).compute())
    home = out / site / condition.replace(" ", "-")
    truth = draw_world(scene_of(site), DECLARED["seed"]).truth()
    mine = truth.loc[truth["kind"] == "metal", ["x", "y"]].to_numpy()[0]
    figure = Figure(figsize=(9.6, 3.5), layout="constrained")
    axes = figure.subplots(1, 3, sharey=True)
    extent = (mine[0] - 1.5, mine[0] + 1.5, mine[1] - 1.5, mine[1] + 1.5)
    top = sum_around(exact, mine, 1.5).max()
    for axis, poses in zip(axes, POSES, strict=True):
        stored = exact if poses == "exact" else open_run(home / f"{poses}.zarr")
        level = sum_around(with_pose(exact, stored["pose"].values), mine, 1.5) - top
        shown = axis.imshow(level, origin="lower", extent=extent, vmin=-20, vmax=0)
        axis.plot(*mine, "o", markersize=26, markerfacecolor="none", color="white")
        axis.set(title=f"{poses} poses", xlabel="x, m")
    axes[0].set_ylabel("y, m")
    figure.colorbar(shown, ax=axes, label="dB")
    figure.savefig(path, dpi=90, metadata={"Software": None})


def focused(out: Path, site: str, condition: str) -> dict[str, Any]:
    """Return what a condition costs on a road, before and after; its runs are stored."""
    exact = road(out, site)
    run = open_run(exact).compute()
    searched = subtract_mean_scan(run)
    pose = run["pose"].values
    wrong = wrong_poses(pose, DECLARED["conditions"][condition], site, condition)
    fit = focus_poses(with_pose(searched, wrong), ImagingOperator)
    home = out / site / condition.replace(" ", "-")
    for name, other in (("wrong", wrong), ("focused", fit.pose)):
        if not (home / f"{name}.zarr").is_dir():
            save_run(with_pose(run, other), home / f"{name}.zarr")
    truth = draw_world(scene_of(site), DECLARED["seed"]).truth()
    metal = truth[truth["kind"] == "metal"]
    best = sums_at_mines(searched, metal)
    height = float(np.median(pose[:, 2]))
    sight = np.array([0.0, 12.0, -height]) / math.hypot(12.0, height)
    row: dict[str, Any] = {"poses": condition, "site": site}
    for name, other in (("before", wrong), ("after", fit.pose)):
        row[f"{name}, mm"] = 1e3 * against_next((other - pose)[:, :3], sight)
        row[f"{name}, as told, mm"] = 1e3 * getattr(fit, name)
        loss = best - sums_at_mines(with_pose(searched, other), metal)
        row[f"loss {name}, dB"] = float(loss.mean())
    row["position over its deviation"] = float(
        np.sqrt(np.mean(((fit.pose - pose)[:, :3] / fit.sigma) ** 2))
    )
    return row | {"pairs alike": f"{fit.alike} of {fit.pairs}", "doubt": fit.doubt}


def by_condition(errors: pd.DataFrame) -> pd.DataFrame:
    """Return the mean errors and losses of every condition over its roads, as text."""
    rows = []
    for condition, of_roads in errors.groupby("poses", sort=False):
        mean = of_roads.drop(columns="site").mean(numeric_only=True)
        row = {"poses": condition}
        row |= {name: f"{mean[name]:.1f}" for name in mean.index if name.endswith("mm")}
        row |= {name: f"{mean[name] + 0.0:.2f}" for name in mean.index if name.endswith("dB")}
        over = "position over its deviation"
        row[over] = f"{of_roads[over].min():.1f} to {of_roads[over].max():.1f}"
        rows.append(row)
    return pd.DataFrame(rows)


def alarms_of(out: Path, site: str, condition: str, poses: str, frames: int) -> pd.DataFrame:
    """Return the alarms on a road with some poses, by the sum of so many scans."""
    home = out / site / condition.replace(" ", "-")
    run = road(out, site) if poses == "exact" else home / f"{poses}.zarr"
    result = (out / site if poses == "exact" else home) / f"result-{poses}-{frames}"
    if not (result / "alarms.csv").is_file():
        recipe = out / f"recipe-{frames}.toml"
        entries = {"near": 8.0, "channel": "HH", "band": [0.45e9, 1.6e9], "frames": frames}
        recipe.write_text(CONTRAST_RECIPE.format(**entries), "utf-8")
        detect(run, recipe=recipe, output=result, report=False, lane=lane())
    return read_table(result / "alarms.csv", "alarms").assign(lane=site)


def lane() -> Lane:
    """Return the border of every road."""
    scene = DECLARED["scene"]
    return Lane(scene["x_min"], scene["x_max"], 0.0, scene["length"])


def found(out: Path, condition: str, frames: int) -> Iterator[dict[str, object]]:
    """Yield how many mines are found under a condition, by wrong, focused and exact poses."""
    truths, lanes = [], {}
    lists: dict[str, list[pd.DataFrame]] = {poses: [] for poses in POSES}
    for site in DECLARED["sites"]:
        for poses in POSES:
            lists[poses].append(alarms_of(out, site, condition, poses, frames))
        world = draw_world(scene_of(site), DECLARED["seed"])
        truths.append(world.truth().assign(lane=site))
        lanes[site] = lane()
    truth = pd.concat(truths, ignore_index=True)
    matches = {
        poses: match(pd.concat(alarms, ignore_index=True), truth, lanes, DECLARED["halo"])
        for poses, alarms in lists.items()
    }
    compared = side_by_side(matches, DECLARED["fars"], means=False)
    points = compared.points.set_index(["detector", "far_allowed"])
    for far in DECLARED["fars"]:
        label = f"{condition}, single scans" if frames == 1 else condition
        row: dict[str, object] = {"poses": label, "per m²": far}
        for poses in POSES:
            point = points.loc[(poses, far)]
            row[poses] = with_share(int(point["n_detected"]), int(point["n_targets"]))
        for rival in ("wrong", "exact"):
            own, its, chance = alone(compared.pairs, far, "focused", rival)
            row[f"focused against {rival}"] = f"{own} against {its}, p = {chance:.2g}"
        yield row


def main() -> None:
    """Focus all poses, detect, and write both tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("--figure", type=Path, help="PNG of sums around a mine")
    given = parser.parse_args()
    errors, mines = [], []
    for condition in DECLARED["conditions"]:
        for site in DECLARED["sites"]:
            errors.append(focused(given.out, site, condition))
            print(errors[-1], flush=True)
        write_table(pd.DataFrame(errors), given.out / "errors.csv")
    write_table(by_condition(pd.DataFrame(errors)), given.out / "pose-errors.csv")
    tried = [(condition, DECLARED["frames"]) for condition in DECLARED["conditions"]]
    tried += [(condition, 1) for condition in DECLARED["single"]]
    for condition, frames in tried:
        mines += found(given.out, condition, frames)
        print(mines[-2], flush=True)
    table = pd.DataFrame(mines)
    write_table(table, given.out / "mines.csv")
    first = table[table.pop("per m²") == DECLARED["fars"][0]]
    write_table(first, given.out / "pose-mines.csv")
    if given.figure:
        draw(given.out, given.figure)


if __name__ == "__main__":
    main()
