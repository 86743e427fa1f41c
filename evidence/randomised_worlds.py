"""A learnt detector with randomised worlds, declared in randomised_worlds.toml: its lanes, its model, its alarms.

``python evidence/randomised_worlds.py lanes OUT`` simulates the training lanes, ``train OUT`` trains the model on them,
and ``detect OUT GROUND`` runs it on the test lanes of a folder of ``flgpr benchmark run`` and writes lists of alarms,
``OUT/alarms/SPLIT.csv``, which ``flgpr benchmark run OUT/alarms -o GROUND`` takes in as an entry. All steps resume.
"""

from __future__ import annotations

import argparse
import tomllib
from pathlib import Path
from typing import Any

import pandas as pd

from flgpr.jobs.job import make_job
from flgpr.jobs.simulated_lane import simulate_to_store
from flgpr.jobs.survey import detect_survey
from flgpr.jobs.training import train_on_lanes
from flgpr.jobs.workers import DEFAULTS
from flgpr.model import load_sensor
from flgpr.recipe.schema import recipe_text
from flgpr.simulate import Scene
from flgpr.simulate.scene.randomised import draw_into, load_worlds
from flgpr.store import read_table, write_table
from flgpr_ground.lanes import read_ground

DECLARED = Path(__file__).with_suffix(".toml")
_BESIDE = ("-lane.toml", "-truth.csv")
RADIUS = 1.0  # m, within which an alarm of a training lane is one of a mine: the halo


def declared() -> dict[str, Any]:
    """Return the declaration."""
    return tomllib.loads(DECLARED.read_text("utf-8"))


def recipe_of(table: dict[str, Any]) -> str:
    """Return the text of the recipe; each replacement changes what stands once."""
    text = recipe_text(table["recipe"])
    for old, new in table["replace"]:
        if text.count(old) != 1:
            raise ValueError(f"recipe must hold {old!r} once, got {text.count(old)}")
        text = text.replace(old, new)
    return text.replace('name = "fused"', 'name = "fused-learnt"')


def seeds_of(table: dict[str, Any]) -> range:
    """Return the seeds of the training lanes."""
    first, last = table["seeds"]
    return range(first, last + 1)


def make_lanes(out: Path) -> None:
    """Simulate the training lanes that are not there yet."""
    table = declared()
    scene = Scene.model_validate(table["scene"])
    worlds = load_worlds(table["worlds"])
    for seed in seeds_of(table):
        drawn_scene, sensor, drawn = draw_into(worlds, scene, load_sensor(table["sensor"]), seed)
        simulate_to_store(drawn_scene, sensor, seed, out / "lanes" / f"{seed}.zarr")
        print(seed, ", ".join(drawn), flush=True)


def train(out: Path) -> None:
    """Train the model."""
    table = declared()
    text = recipe_of(table)
    (out / "recipe.toml").write_text(text, encoding="utf-8")
    jobs = []
    for seed in seeds_of(table):
        files = [out / "lanes" / f"{seed}{ending}" for ending in (".zarr", *_BESIDE)]
        run, lane, truth = files
        jobs.append(make_job(run, text, lane, out / "model", False, truth=truth))
    train_on_lanes(jobs, out / "model", (), RADIUS, DEFAULTS, overwrite=False)


def detect(out: Path, benchmark: Path) -> None:
    """Write the alarms of all splits of a benchmark's ground, of all its tiers together."""
    text = (out / "recipe.toml").read_text("utf-8")
    ground = read_ground(benchmark)
    (out / "alarms").mkdir(exist_ok=True)
    for split in ground.table.splits:
        tables = []
        for tier in ground.chosen_tiers():
            tables += [alarms_of(out, benchmark, text, lane.name) for lane in tier.tested(split)]
        write_table(pd.concat(tables, ignore_index=True), out / "alarms" / f"{split}.csv")
        print(split, flush=True)


def alarms_of(out: Path, benchmark: Path, text: str, lane: str) -> pd.DataFrame:
    """Return the alarms of a lane, detected unless that was done."""
    found = out / "results" / lane
    if not found.is_dir():
        run = benchmark / "lanes" / f"{lane}.zarr"
        border = run.with_name(f"{lane}-lane.toml")
        job = make_job(run, text, border, found, False, out / "model")
        detect_survey([job], out / "results")
    return read_table(found / "alarms.csv", "alarms").assign(lane=lane)


def main() -> None:
    """Run one of the steps."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("step", choices=["lanes", "train", "detect"])
    parser.add_argument("out", type=Path)
    parser.add_argument("ground", type=Path, nargs="?", help="folder of flgpr benchmark run")
    options = parser.parse_args()
    if options.step == "lanes":
        make_lanes(options.out)
    elif options.step == "train":
        train(options.out)
    elif options.ground is None:
        parser.error("detect needs the folder of the benchmark")
    else:
        detect(options.out, options.ground)


if __name__ == "__main__":
    main()
