"""The rules that fit `fused` to an array, tried on twins of eight arrays, evidence/recipe_rules.toml.

``python evidence/recipe_rules.py run OUT [--arrays NAME ...] [--mines N] [--world plain]`` fits the recipe to every
array, trains it on simulated lanes and writes the alarms of every test lane. It resumes, and with more mines extends.
``python evidence/recipe_rules.py tables OUT`` prints mines found by the fitted recipe and by C_HH, paired.
``python evidence/recipe_rules.py stands-out OUT`` prints how many of what stands out by each lane's own tail are mines.
``python evidence/recipe_rules.py full-wave OUT`` trains the recipe on the training lanes of the ground full-wave-2 and
counts on its solved lanes, once and last.
"""

from __future__ import annotations

import argparse
import sys
import time
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

sys.path.append(str(Path(__file__).parent))
from common import markdown, with_share
from flgpr import train
from flgpr.jobs.check_on_twins import (
    Twin,
    draw_scene,
    matched,
    plan_twins,
    simulate_twin,
    twins_for,
)
from flgpr.method.method import detect
from flgpr.method.model import Model, load_model
from flgpr.method.stands_out import tail_threshold
from flgpr.model import Sensor, load_sensor, make_run
from flgpr.proving_ground import load_ground, run_benchmark, write_score_tables
from flgpr.recipe.make import fit_recipe
from flgpr.recipe.schema import Recipe, parse_recipe
from flgpr.scoring import Match, side_by_side
from flgpr.store import open_run, read_table, save_run, write_table
from flgpr.store.tables import read_columns
from flgpr.toml_text import parse_toml, toml_lines

DECLARED = Path(__file__).with_suffix(".toml")
FITTED, CONTRAST, SAME_IMAGES = "fitted", "contrast", "contrast-same"
ECHO = "echo"  # the world with the ground's echo and the direct wave; "plain" is without
FULL_WAVE = "full-wave-2"
COUNTED = ["x", "y", "confidence"]
DRIVE = 8  # scans of a drive that the recipe is fitted to


def declared() -> dict[str, Any]:
    """Return the declaration of the trial."""
    return tomllib.loads(DECLARED.read_text("utf-8"))


def sensor_of(array: dict[str, Any]) -> Sensor:
    """Return the sensor of a declared array."""
    changes = {}
    for entry in ("height", "tones", "tx", "rx", "polarization"):
        if entry in array:
            changes[entry] = array[entry]
    base = load_sensor(array["sensor"]).model_dump()
    if "scanned" in base and "rx" in changes:
        base["scanned"] = False
    return Sensor.model_validate(base | changes)


def bare_run(array: dict[str, Any], sensor: Sensor) -> xr.Dataset:
    """Return a run without echoes, as the array would take it: what a recipe is fitted to."""
    y = array.get("positions") or [array["step"] * scan for scan in range(DRIVE)]
    pose = np.zeros((len(y), 6))
    pose[:, 1] = y
    pose[:, 2] = sensor.height
    tx, rx = sensor.pairs()
    tones = sensor.tones.axis()
    shape = (len(y), len(sensor.polarization), len(tx), len(tones))
    return make_run(np.zeros(shape, np.complex64), tones, sensor.polarization, tx, rx, pose)


def fitted_text(run: xr.Dataset, sensor_file: Path) -> str:
    """Return the fitted recipe of an array, with the declared antennas' pattern and errors."""
    text = fit_recipe(run, like="fused")
    tables = parse_toml(text)
    tables["map"]["antennas"] = str(sensor_file)
    return "\n".join(toml_lines(tables, {})) + "\n"


def same_images(recipe: Recipe, run: xr.Dataset) -> Recipe:
    """Return C_HH of the images of a fitted recipe, in its widest sub-band."""
    tables = parse_toml("\n".join(toml_lines(contrast_tables(run), {})))
    dumped = recipe.model_dump(mode="json")
    image = {name: value for name, value in dumped["image"].items() if value not in (None, [], ())}
    tables["image"] = image
    widest = max(recipe.image.subbands, key=lambda name: np.ptp(recipe.image.subbands[name]))
    for table in ("prescreen", "contrast"):
        tables[table]["subband"] = widest
    return parse_recipe("\n".join(toml_lines(tables, {})))


def contrast_tables(run: xr.Dataset) -> dict[str, Any]:
    """Return the tables of the recipe that is fitted to a run without a model, without features."""
    tables = parse_toml(fit_recipe(run))
    tables.pop("features", None)
    return tables


class Trial:
    """The trial of one array in one world."""

    def __init__(self, out: Path, array: dict[str, Any], world: str) -> None:
        self.common = declared() | array
        self.folder = out / world / array["name"]
        self.folder.mkdir(parents=True, exist_ok=True)
        sensor = sensor_of(array)
        self.sensor_file = self.folder / "sensor.toml"
        self.sensor_file.write_text("\n".join(toml_lines(_plain(sensor), {})) + "\n")
        self.run = bare_run(array, sensor)
        self.recipe_file = self.folder / "recipe.toml"
        text = fitted_text(self.run, self.sensor_file)
        if self.recipe_file.exists() and self.recipe_file.read_text() != text:
            raise ValueError(f"{self.folder} is of other rules")
        self.recipe_file.write_text(text)
        self.recipe = parse_recipe(text)
        self.plan = plan_twins(self.run, self.recipe, echoes=world == ECHO)

    def model(self) -> Model:
        """Return the model of the fitted recipe, trained if there is none."""
        folder = self.folder / "model"
        if (folder / "model.bundle").is_file():
            return load_model(folder)
        runs, truths, lanes = [], [], []
        for number in range(twins_for(self.plan, self.common["train"])):
            twin = simulate_twin(self.plan, number, self.common["train_seed"])
            runs.append(self.folder / f"train-{number}.zarr")
            save_run(twin.run, runs[-1], overwrite=True)
            truths.append(self.folder / f"train-{number}.csv")
            write_table(twin.truth, truths[-1])
            lanes.append(twin.lane)
        return train(
            runs,
            truths,
            recipe=self.recipe_file,
            output=folder,
            lanes=lanes,
            workers=1,
            check=False,
        )

    def test(self, mines: int) -> None:
        """Write alarms of every test lane that has none."""
        model = self.model()
        plain = parse_recipe("\n".join(toml_lines(contrast_tables(self.run), {})))
        recipes = {
            FITTED: self.recipe,
            CONTRAST: plain,
            SAME_IMAGES: same_images(self.recipe, self.run),
        }
        seed = self.common["test_seed"]
        for number in range(twins_for(self.plan, mines)):
            files = {name: self.folder / f"{name}-{number:03d}.csv" for name in recipes}
            if all(path.is_file() for path in files.values()):
                continue
            begun = time.perf_counter()
            twin = simulate_twin(self.plan, number, seed)
            write_table(twin.truth, self.folder / f"truth-{number:03d}.csv")
            for name, recipe in recipes.items():
                known = model if name == FITTED else None
                alarms = detect(twin.run, recipe, twin.lane, model=known).alarms
                write_table(alarms[COUNTED], files[name])
            print(f"{self.folder.name} {number}: {time.perf_counter() - begun:.0f} s", flush=True)

    def matches(self) -> dict[str, Match]:
        """Return the alarms of all test lanes there are, matched, by detector."""
        twins = []
        tables: dict[str, list[pd.DataFrame]] = {FITTED: [], CONTRAST: [], SAME_IMAGES: []}
        for path in sorted(self.folder.glob("truth-*.csv")):
            number = path.stem.removeprefix("truth-")
            files = {name: self.folder / f"{name}-{number}.csv" for name in tables}
            if not all(file.is_file() for file in files.values()):
                continue
            scene = draw_scene(self.plan, int(number), self.common["test_seed"])
            truth = read_table(path, "truth").assign(lane=scene.name)
            twins.append(Twin(scene.name, self.run, scene.lane, truth))
            for name, file in files.items():
                tables[name].append(pd.read_csv(file))
        if not twins:
            return {}
        halo = self.common["halo"]
        return {name: matched(found, twins, halo) for name, found in tables.items()}


def _plain(sensor: Sensor) -> dict[str, Any]:
    """Return the entries of a sensor without those that are not set."""
    entries = sensor.model_dump(mode="json", exclude_none=True)
    return {name: value for name, value in entries.items() if value is not None}


def print_tables(out: Path, world: str) -> None:
    """Print mines found of every array, and of all together."""
    common = declared()
    rows = []
    total = {far: np.zeros(4, int) for far in common["fars"]}
    for array in common["arrays"]:
        if not (out / world / array["name"] / "recipe.toml").is_file():
            continue
        trial = Trial(out, array, world)
        matches = trial.matches()
        if not matches:
            continue
        compared = side_by_side(matches, common["fars"], means=False)
        points = compared.points.set_index(["detector", "far_allowed"])
        pairs = compared.pairs[
            (compared.pairs["first"] == FITTED) & (compared.pairs["second"] == CONTRAST)
        ].set_index("far_allowed")
        for far in common["fars"]:
            found = {name: int(points.loc[(name, far), "n_detected"]) for name in matches}
            count = int(points.loc[(FITTED, far), "n_targets"])
            pair = pairs.loc[far]
            alone = int(pair["only_first"]), int(pair["only_second"])
            total[far] += [found[FITTED], found[CONTRAST], *alone]
            chance = points.loc[(FITTED, far), "chance"]
            rows.append(
                [
                    array["name"],
                    f"{far:g}",
                    with_share(found[FITTED], count),
                    with_share(found[CONTRAST], count),
                    found[SAME_IMAGES],
                    f"+{alone[0]} -{alone[1]}",
                    f"{pair['difference']:+.2f} ({pair['low']:+.2f} to {pair['high']:+.2f})",
                    f"{pair['p']:.2g}",
                    f"{chance:.2f}",
                ]
            )
    head = [
        "array",
        "per m²",
        "fitted",
        "C_HH",
        "C_HH, same images",
        "alone",
        "difference",
        "p",
        "chance",
    ]
    print(markdown(head, rows))
    for far, (fitted, contrast, first, second) in total.items():
        print(f"all at {far:g}: fitted {fitted}, C_HH {contrast}, alone +{first} -{second}")


def print_outstanding(out: Path, world: str) -> None:
    """Print what stands out by the tail of each lane's own alarms, and how many of it are mines."""
    halo = declared()["halo"]
    rows = []
    for array in declared()["arrays"]:
        folder = out / world / array["name"]
        for name in (FITTED, CONTRAST):
            outstanding, mines, lanes, truths = 0, 0, 0, 0
            for path in sorted(folder.glob(f"{name}-[0-9]*.csv")):
                number = path.stem.removeprefix(f"{name}-")
                truth = read_table(folder / f"truth-{number}.csv", "truth")[["x", "y"]].to_numpy()
                alarms = pd.read_csv(path)
                # Alarms stand in the lane alone, and reach its borders nearly.
                area = np.prod(np.ptp(alarms[["x", "y"]].to_numpy(), axis=0))
                border = tail_threshold(alarms["confidence"].to_numpy(float), float(area))
                border = np.inf if border is None else border
                places = alarms.loc[alarms["confidence"] >= border, ["x", "y"]].to_numpy()
                off = np.linalg.norm(places[:, None] - truth, axis=-1)
                lanes += 1
                truths += len(truth)
                outstanding += len(places)
                mines += int((off.min(axis=1) <= halo).sum()) if len(places) else 0
            if lanes:
                false = (outstanding - mines) / lanes
                row = [array["name"], name, lanes, truths, outstanding]
                rows.append([*row, with_share(mines, outstanding), f"{false:.2f}"])
    head = ["array", "detector", "lanes", "mines", "stand out", "of these mines", "others a lane"]
    print(markdown(head, rows))


def on_full_wave(out: Path) -> None:
    """Run the fitted recipe and C_HH on the solved lanes of full-wave-2, and print their scores."""
    ground = load_ground(source=FULL_WAVE)
    lane = ground.tested("full-wave")[0]
    path = out / "fused-by-rules.toml"
    text = fit_recipe(open_run(lane.stored[0]), like="fused")
    path.write_text(text.replace('name = "fused-fitted"', 'name = "fused-by-rules"'))
    run_benchmark(["wang2007", str(path)], out / FULL_WAVE, ground=FULL_WAVE)
    print(write_score_tables([out / FULL_WAVE], out / FULL_WAVE))
    scores = read_columns(out / FULL_WAVE / "scores.csv")
    mines = scores[(scores["split"] == "full-wave") & (scores["group"] == "mines")]
    shown = ["entry", "far_allowed", "n_detected", "n_targets", "pd_low", "pd_high", "chance"]
    print(mines[shown].to_string(index=False))


def main() -> None:
    """Run the trial, or print its tables."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("step", choices=["run", "tables", "stands-out", "full-wave"])
    parser.add_argument("out", type=Path)
    parser.add_argument("--arrays", nargs="*", default=[])
    parser.add_argument("--mines", type=int)
    parser.add_argument("--world", default="plain")
    given = parser.parse_args()
    if given.step == "tables":
        print_tables(given.out, given.world)
        return
    if given.step == "stands-out":
        print_outstanding(given.out, given.world)
        return
    if given.step == "full-wave":
        on_full_wave(given.out)
        return
    common = declared()
    names = given.arrays or [array["name"] for array in common["arrays"]]
    by_name = {array["name"]: array for array in common["arrays"]}
    for name in names:
        Trial(given.out, by_name[name], given.world).test(given.mines or common["test"])


if __name__ == "__main__":
    main()
