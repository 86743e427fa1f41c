"""Nominal and realised false-alarm rates, with one site left out: the lanes of evidence/unlike_ground.toml, [rates].

``python evidence/false_alarm_rate.py lanes OUT`` simulates the lanes, ``... run OUT`` trains a model without each site
and detects on the lanes of that site, ``... tables OUT [--figure FILE]`` prints on how many lanes the realised rate is
at most the nominal one, and draws both. Every step leaves out what is there.
"""

from __future__ import annotations

import argparse
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

sys.path.append(str(Path(__file__).parent))
from common import markdown, with_share
from flgpr.commands.train import train
from flgpr.method.false_alarms import own_threshold, training_threshold
from flgpr.method.method import detect
from flgpr.method.model import load_model
from flgpr.model import Lane, load_sensor
from flgpr.proving_ground import load_ground
from flgpr.recipe.make import fit_recipe
from flgpr.recipe.schema import parse_recipe
from flgpr.scoring import match
from flgpr.simulate import Scene, Simulator, draw_world
from flgpr.store import open_run, read_table, write_run, write_table

DECLARED = tomllib.loads(Path(__file__).with_name("unlike_ground.toml").read_text("utf-8"))
RATES = DECLARED["rates"]
NOMINAL = np.geomspace(0.01, 0.4, 17)
SOURCES = {"training": "other sites' lanes", "lane": "the lane itself", "either": "the higher of both"}


class OneLane(NamedTuple):
    """A lane of the list."""

    part: str
    site: str
    seed: int

    @property
    def name(self) -> str:
        """Its name."""
        return f"{self.part}-{self.site}-{self.seed}"


def lanes(part: str) -> Iterator[OneLane]:
    """Yield the lanes of a part."""
    count = RATES[part]["per_site"]
    for number, site in enumerate(RATES["sites"]):
        for copy in range(count):
            yield OneLane(part, site, RATES[part]["first"] + number * count + copy)


def borders() -> Lane:
    """Return the borders of every lane."""
    half = RATES["half_width"]
    return Lane(-half, half, 0.0, RATES["length"])


def scene_of(lane: OneLane) -> Scene:
    """Return the scene of a lane."""
    sorts = load_ground(source="full-wave-2").table.sorts
    draws = []
    for sort, depth, count in RATES["targets"]:
        draws.append({"kind": sorts[sort].kind, "body": sorts[sort].body, "depth": depth, "count": count})
    half = RATES["half_width"]
    return Scene.model_validate(
        {
            "name": lane.name,
            "site": lane.site,
            "x_min": -half,
            "x_max": half,
            "length": RATES["length"],
            "track": {"step": RATES["step"]},
            "draws": draws,
        }
    )


def make_lanes(out: Path) -> None:
    """Simulate the lanes that are not there yet."""
    out.mkdir(parents=True, exist_ok=True)
    sensor = load_sensor(RATES["sensor"]).model_copy(
        update={"polarization": tuple(RATES["polarization"])}
    )
    for part in ("train", "test"):
        for lane in lanes(part):
            store = out / f"{lane.name}.zarr"
            if store.exists():
                continue
            scene = scene_of(lane)
            write_table(draw_world(scene, lane.seed).truth(), out / f"{lane.name}.csv")
            write_run(Simulator(scene, sensor, lane.seed).run(), store)


def model_without(out: Path, site: str) -> Path:
    """Train the fitted recipe on the training lanes of the other sites."""
    known = [lane for lane in lanes("train") if lane.site != site]
    recipe = out / "fused.toml"
    if not recipe.exists():
        first = open_run(out / f"{known[0].name}.zarr")
        recipe.write_text(fit_recipe(first, like="fused"), encoding="utf-8")
    model = out / f"model-without-{site}"
    if not model.exists():
        train(
            [out / f"{lane.name}.zarr" for lane in known],
            [out / f"{lane.name}.csv" for lane in known],
            recipe,
            model,
            lanes=[borders()] * len(known),
            label_radius=RATES["halo"],
        )
    return model


def run(out: Path) -> None:
    """Detect on the test lanes of every site by the model that never saw it."""
    for site in RATES["sites"]:
        model = load_model(model_without(out, site))
        recipe = parse_recipe((out / "fused.toml").read_text("utf-8"))
        for lane in lanes("test"):
            path = out / f"{lane.name}-alarms.csv"
            if lane.site != site or path.exists():
                continue
            found = detect(open_run(out / f"{lane.name}.zarr"), recipe, borders(), model=model, unlike="keep")
            write_table(found.alarms, path)


def realised(out: Path) -> pd.DataFrame:
    """Return for every lane, nominal rate and source of the threshold the realised rate and mines found."""
    rows: list[dict[str, Any]] = []
    for site in RATES["sites"]:
        ground = load_model(out / f"model-without-{site}").ground
        for lane in lanes("test"):
            path = out / f"{lane.name}-alarms.csv"
            if lane.site != site or not path.exists():
                continue
            alarms = read_table(path, "alarms")
            truth = read_table(out / f"{lane.name}.csv", "truth")
            matched = match(
                alarms.assign(lane=lane.name),
                truth.assign(lane=lane.name),
                {lane.name: borders()},
                RATES["halo"],
            )
            _, best, _ = matched.best()
            inside = borders().contains(alarms["x"], alarms["y"])
            confidence = alarms["confidence"].to_numpy()
            for nominal in (*RATES["nominal"], *NOMINAL):
                levels = {
                    "training": training_threshold(ground.free, nominal).threshold,
                    "lane": own_threshold(confidence[inside], borders().area, nominal).threshold,
                }
                levels["either"] = max(levels.values())
                for source, level in levels.items():
                    false = int((matched.false & (matched.confidence > level)).sum())
                    rows.append(
                        {
                            "site": site,
                            "lane": lane.name,
                            "nominal": float(nominal),
                            "source": source,
                            "false": false,
                            "realised": false / borders().area,
                            "found": int((best > level).sum()),
                            "mines": len(truth),
                        }
                    )
    return pd.DataFrame(rows)


def print_tables(table: pd.DataFrame) -> None:
    """Print on how many lanes each source keeps the nominal rates."""
    rows = []
    for nominal in RATES["nominal"]:
        for source, words in SOURCES.items():
            some = table[(table["nominal"] == nominal) & (table["source"] == source)]
            some = some.drop_duplicates("lane")
            kept = some["realised"] <= nominal + 1e-9
            by_site = [f"{kept[some['site'] == site].sum()}" for site in RATES["sites"]]
            rows.append(
                [
                    f"{nominal:g}",
                    words,
                    with_share(int(kept.sum()), len(some)),
                    ", ".join(by_site),
                    f"{some['realised'].mean():.3f}",
                    f"{some['found'].sum()} of {some['mines'].sum()}",
                ]
            )
    head = [
        "nominal, per m²",
        "threshold by",
        "lanes within it (95 % interval)",
        "by site",
        "mean realised, per m²",
        "mines found",
    ]
    print(markdown(head, rows))


def draw(table: pd.DataFrame, path: Path) -> None:
    """Draw the realised rate against the nominal one: every lane, their mean and 95 % of them."""
    figure = Figure(figsize=(9.5, 4.2), layout="constrained")
    panels = figure.subplots(1, 2, sharey=True)
    for axes, source in zip(panels, ("training", "lane"), strict=True):
        some = table[(table["source"] == source) & table["nominal"].isin(NOMINAL)]
        grouped = some.groupby("nominal")["realised"]
        nominal = np.array(sorted(some["nominal"].unique()))
        jitter = np.random.default_rng(0).uniform(0.96, 1.04, len(some))
        lowest = 0.4 / borders().area  # where none was counted
        axes.plot(
            some["nominal"] * jitter, np.maximum(some["realised"], lowest), ".", color="0.7", ms=4,
            label="a lane",
        )  # fmt: skip
        axes.plot(nominal, np.maximum(grouped.mean(), lowest), "o-", color="tab:blue", label="mean of lanes")
        high = grouped.quantile(0.95, interpolation="higher")
        axes.plot(nominal, np.maximum(high, lowest), "s-", color="tab:red", label="95 % of lanes are below")
        axes.plot(nominal, nominal, "k--", label="realised = nominal")
        axes.set(xscale="log", yscale="log", xlabel="nominal, per m²", title=f"threshold by {SOURCES[source]}")
        axes.grid(alpha=0.3)
    panels[0].set_ylabel("realised false alarms per m² (none: lowest line)")
    panels[0].legend(fontsize=8)
    figure.savefig(path, dpi=100)


def main() -> None:
    """Run a step."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("step", choices=("lanes", "run", "tables"))
    parser.add_argument("out", type=Path)
    parser.add_argument("--figure", type=Path)
    given = parser.parse_args()
    if given.step == "lanes":
        make_lanes(given.out)
    elif given.step == "run":
        run(given.out)
    else:
        table = realised(given.out)
        print_tables(table)
        if given.figure is not None:
            draw(table, given.figure)


if __name__ == "__main__":
    main()
