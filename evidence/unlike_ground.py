"""How often a model says that ground is unlike its training: on the lanes of evidence/unlike_ground.toml.

``python evidence/unlike_ground.py train OUT`` trains `fused`, fitted to the array of the ground full-wave-2, on the
ground's training lanes. ``... measure OUT LIST`` (rule, trial or solved) measures the lanes of a list, each for itself,
and writes OUT/LIST.csv; lanes that stand there are left out. ``... tables OUT`` prints how many lanes of each list
speak, by the chance of each figure, and what the solved lanes measure.
"""

from __future__ import annotations

import argparse
import sys
import time
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

sys.path.append(str(Path(__file__).parent))
from common import made_lanes, markdown, with_share
from flgpr.commands.train import train
from flgpr.method.imaged_run import ImagedRun
from flgpr.method.method import engine_of
from flgpr.method.model import load_model
from flgpr.method.unlike import CHANCE, Trust, limit_of
from flgpr.model import Lane
from flgpr.proving_ground import load_ground, packaged_entries
from flgpr.recipe.schema import parse_recipe
from flgpr.simulate import Simulator
from flgpr.store import open_run
from flgpr_ground.ground import Ground

DECLARED = tomllib.loads(Path(__file__).with_suffix(".toml").read_text("utf-8"))
LIKE = DECLARED["like"]
FIGURES = ("level", "divergence", "eigenvalue", "beyond")
CHANCES = (0.01, 0.005, 0.002, 0.001, 0.0005)
Known = tuple[str, xr.Dataset, Lane]


def ground() -> Ground:
    """Return the ground whose training lanes the model knows."""
    return load_ground(source=LIKE["ground"])


def train_model(out: Path) -> None:
    """Simulate the training lanes, and train the fitted recipe on them."""
    out.mkdir(parents=True, exist_ok=True)
    (out / "fused.toml").write_text(packaged_entries(ground())["fused"].text, encoding="utf-8")
    lanes = [lane for lane in ground().lanes.values() if lane.part == "train"]
    runs, truths = made_lanes(out, lanes)
    train(runs, truths, out / "fused.toml", out / "model", overwrite=False)


def lanes_of(name: str) -> Iterator[Known]:
    """Yield the lanes of a list by name, with their borders."""
    if name == "solved":
        for lane in ground().lanes.values():
            if lane.part == DECLARED["unlike"]["part"]:
                yield lane.name, open_run(lane.stored[0]), lane.lane
        return
    rows = [lane for lane in ground().lanes.values() if lane.name.endswith("-1")]
    by_row = {lane.name.removeprefix("arid-").removesuffix("-1"): lane for lane in rows}
    for number in range(LIKE[name]["lanes"]):
        row = LIKE["rows"][number % len(LIKE["rows"])]
        seed = LIKE[name]["first"] + number
        lane = by_row[row]
        yield f"{row}-{seed}", Simulator(lane.scene, lane.sensor, seed).run(), lane.lane


def measure(out: Path, name: str) -> None:
    """Measure the lanes of a list, and write their figures and what they cost."""
    path = out / f"{name}.csv"
    rows: list[dict[str, Any]] = []
    if path.is_file():
        rows = pd.read_csv(path).to_dict("records")
    known = {row["lane"] for row in rows}
    model = load_model(out / "model")
    recipe = parse_recipe((out / "fused.toml").read_text("utf-8"))
    for lane_name, run, lane in lanes_of(name):
        if lane_name in known:
            continue
        setup = ImagedRun(run, recipe, lane, model, trust=Trust(only_measures=True))
        engine_of(setup).run()
        begun = time.perf_counter()
        comparison = setup.comparison
        row = {"lane": lane_name, "seconds": time.perf_counter() - begun}
        for figure in comparison.figures:
            row[figure.name] = figure.value
        rows.append(row)
        pd.DataFrame(rows).to_csv(path, index=False)


def limits(out: Path, chance: float) -> dict[str, float]:
    """Return the limits of lanes of two scans by a chance."""
    known = load_model(out / "model").ground
    size = known.sizes[-1]
    by_name = {"level": known.level, **{name: getattr(size, name) for name in FIGURES[1:]}}
    return {name: limit_of(name, values, chance) for name, values in by_name.items()}


def print_tables(out: Path) -> None:
    """Print how many lanes speak, by chance and figure, and the solved lanes."""
    rows = []
    for name in ("rule", "trial", "solved"):
        path = out / f"{name}.csv"
        if not path.is_file():
            continue
        table = pd.read_csv(path)
        for chance in CHANCES if name == "rule" else (CHANCE,):
            bounds = limits(out, chance)
            beyond = np.stack([table[figure] > bounds[figure] for figure in FIGURES])
            counts = [int(of_figure.sum()) for of_figure in beyond]
            spoken = with_share(int(beyond.any(axis=0).sum()), len(table))
            rows.append([name, chance, spoken, *counts])
    print(markdown(["lanes", "chance of each figure", "speak (95 % interval)", *FIGURES], rows))
    if (out / "solved.csv").is_file():
        bounds = limits(out, CHANCE)
        solved = pd.read_csv(out / "solved.csv")
        rows = [
            [row["lane"], *(f"{row[name]:.3g}" for name in FIGURES)] for _, row in solved.iterrows()
        ]
        rows.append(["limit", *(f"{bounds[name]:.3g}" for name in FIGURES)])
        print(markdown(["lane", *FIGURES], rows))


def main() -> None:
    """Run a step."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("step", choices=("train", "measure", "tables"))
    parser.add_argument("out", type=Path)
    parser.add_argument("list", nargs="?", choices=("rule", "trial", "solved"))
    given = parser.parse_args()
    if given.step == "train":
        train_model(given.out)
    elif given.step == "measure":
        measure(given.out, given.list)
    else:
        print_tables(given.out)


if __name__ == "__main__":
    main()
