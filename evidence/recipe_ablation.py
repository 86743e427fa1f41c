"""Why two packaged recipes find fewer mines than the studies of their papers: one change at a time.

``python evidence/recipe_ablation.py OUT {cosgrove2004,fuse2018} [--workers N]`` simulates the lanes that
``recipe_ablation.toml`` declares, trains and runs every variant of the recipe on them, and prints how many mines each
finds. What is there is kept, so that an interrupted run resumes.
"""

from __future__ import annotations

import argparse
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from common import markdown, with_share
from flgpr import detect, train
from flgpr.commands.simulate import simulate_lane
from flgpr.model import Lane
from flgpr.recipe.schema import parse_recipe, recipe_text
from flgpr.scoring import roc
from flgpr.store import read_table
from flgpr.toml_text import parse_toml, toml_lines

DECLARED = Path(__file__).with_suffix(".toml")


class Ablation:
    """The variants of one recipe."""

    def __init__(self, out: Path, name: str, workers: int) -> None:
        self.declared = tomllib.loads(DECLARED.read_text("utf-8"))
        self.case = self.declared[name]
        self.name = name
        self.folder = out / name
        self.workers = workers

    def rows(self) -> Iterator[list[object]]:
        """Run all variants and yield a row of counts of each."""
        for variant, changes in self.case["variants"].items():
            curve = self.curve(variant, [self.case["changes"][change] for change in changes])
            counts = [curve.n_detected[curve.far <= far].max() for far in self.declared["fars"]]
            count = curve.attrs["n_targets"]
            yield [variant, *(with_share(int(found), count) for found in counts)]

    def curve(self, variant: str, changes: list[dict[str, Any]]) -> pd.DataFrame:
        """Return the ROC of a variant over all test lanes."""
        chosen = dict(self.case["base"])
        for change in changes:
            chosen |= change
        sensor, clutter, names = chosen["sensor"], chosen.get("clutter", {}), chosen["train"]
        tests = chosen["test"]
        world = self.folder / f"{sensor}{'-open' if clutter else ''}"
        lanes = {name: self.lane(world, name, sensor, clutter) for name in [*names, *tests]}
        home = self.folder / variant.replace(", ", "-").replace(" ", "-")
        home.mkdir(parents=True, exist_ok=True)
        recipe = home / "recipe.toml"
        recipe.write_text(self.recipe(changes), "utf-8")
        model = None
        if parse_recipe(recipe.read_text("utf-8")).learning():
            model = home / "model"
            if not (model / "model.bundle").is_file():
                train(
                    [lanes[name] for name in names],
                    [truth_of(lanes[name]) for name in names],
                    recipe=recipe,
                    output=model,
                    workers=self.workers,
                    check=False,
                )
        alarms, truths = [], []
        for name in tests:
            result = home / name
            if not (result / "alarms.csv").is_file():
                detect(lanes[name], recipe=recipe, output=result, model=model, workers=self.workers)
            alarms.append(read_table(result / "alarms.csv", "alarms").assign(lane=name))
            truths.append(read_table(truth_of(lanes[name]), "truth").assign(lane=name))
        scene = self.case["scene"]
        borders = {
            name: Lane(scene["x_min"], scene["x_max"], 0.0, self.case["lanes"][name]["length"])
            for name in tests
        }
        truth = pd.concat(truths, ignore_index=True)
        # Those of the first scene: another site only sets the threshold.
        counted = self.case["base"]["test"]
        return roc(
            pd.concat(alarms, ignore_index=True),
            truth,
            borders,
            self.case["halo"],
            lambda targets: targets["lane"].isin(counted),
        )

    def lane(self, world: Path, name: str, sensor: str, clutter: dict[str, float]) -> Path:
        """Return the run of a lane, simulated if it is not there."""
        run = world / f"{name}.zarr"
        if not run.exists():
            world.mkdir(parents=True, exist_ok=True)
            scene = world / f"{name}.toml"
            lane = self.case["lanes"][name]
            tables = self.case["scene"] | {"name": name, "length": lane["length"]}
            tables["site"] = lane.get("site", tables["site"])
            if clutter:
                tables["clutter"] = clutter
            tables["targets"] = list(placed(lane))
            scene.write_text("\n".join(toml_lines(tables, {})) + "\n", "utf-8")
            simulate_lane(scene, output=run, sensor=sensor, seed=lane["seed"])
        return run

    def recipe(self, changes: list[dict[str, Any]]) -> str:
        """Return the text of the recipe of a variant; each replacement changes what stands once."""
        text = recipe_text(self.case.get("recipe", self.name))
        for old, new in [
            *self.case["base"]["replace"],
            *(r for c in changes for r in c.get("replace", [])),
        ]:
            if text.count(old) != 1:
                raise ValueError(f"the recipe must have {old!r} once, got {text.count(old)}")
            text = text.replace(old, new)
        without = [change["without"] for change in changes if "without" in change]
        if without:
            tables = parse_toml(text)
            tables["clutter"] = [one for one in tables["clutter"] if one["stage"] not in without]
            text = "\n".join(toml_lines(tables, {})) + "\n"
        return text


def placed(lane: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """Yield the targets of a lane, in an order and at places that its seed draws."""
    rng = np.random.default_rng(lane["seed"])
    sorts = [
        (kind, body, depth) for kind, body, depth, count in lane["targets"] for _ in range(count)
    ]
    step = lane["length"] / len(sorts)
    for number, index in enumerate(rng.permutation(len(sorts))):
        kind, body, depth = sorts[index]
        place = {"x": float(rng.uniform(-1.1, 1.1)), "y": (number + 0.5) * step}
        yield {"kind": kind, "depth": depth, **place, **({"body": body} if body else {})}


def truth_of(run: Path) -> Path:
    """Return the truth beside a run."""
    return run.with_name(f"{run.stem}-truth.csv")


def main() -> None:
    """Run the variants of a recipe and print what each finds."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("recipe", choices=["cosgrove2004", "fuse2018"])
    parser.add_argument("--workers", type=int, default=1)
    given = parser.parse_args()
    ablation = Ablation(given.out, given.recipe, given.workers)
    heads = ["variant", *(f"at {far:g} per m²" for far in ablation.declared["fars"])]
    print(markdown(heads, list(ablation.rows())))


if __name__ == "__main__":
    main()
