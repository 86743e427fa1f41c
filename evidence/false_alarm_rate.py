"""Nominal and realised false-alarm rates with one soil left out: the lanes of evidence/unlike_ground.toml, [rates].

``python evidence/false_alarm_rate.py run OUT WORLD`` (plain, echo or solved) trains a model without each soil and
detects on the lanes of that soil as `flgpr detect` does; what is there is left out. ``... tables OUT [--figure FILE]``
prints on how many lanes the realised rate is at most the nominal one, and draws both.
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
import xarray as xr
from matplotlib.figure import Figure

sys.path.append(str(Path(__file__).parent))
from common import made_lanes, markdown, with_share
from flgpr.commands.train import train
from flgpr.method.detection import AS_LEARNT
from flgpr.method.false_alarms import own_threshold, training_threshold
from flgpr.method.method import detect
from flgpr.method.model import Model, load_model
from flgpr.model import Lane
from flgpr.proving_ground import load_ground, packaged_entries
from flgpr.recipe.schema import parse_recipe
from flgpr.scoring import match
from flgpr.simulate import Simulator, draw_world
from flgpr.store import open_run, read_table, write_table
from flgpr_ground.ground import Ground, GroundLane

DECLARED = tomllib.loads(Path(__file__).with_name("unlike_ground.toml").read_text("utf-8"))
RATES = DECLARED["rates"]
WORLDS = {
    "plain": "new lanes, as simulated",
    "echo": "new lanes with the ground's echo",
    "solved": "solved lanes",
}
RANKED = {"kept": "as learnt, kept", "delivered": "as `flgpr detect` gives it"}
NOMINAL = np.linspace(0.02, 0.48, 47)


class OneLane(NamedTuple):
    """A lane that is tried."""

    name: str
    run: xr.Dataset
    lane: Lane
    truth: pd.DataFrame


def ground() -> Ground:
    """Return the ground of the training lanes."""
    return load_ground(source=RATES["ground"])


def of_row(row: str) -> list[GroundLane]:
    """Return the ground's lanes of a row."""
    return [
        lane for lane in ground().lanes.values() if lane.name.rpartition("-")[0] == f"arid-{row}"
    ]


def lanes_of(world: str, soil: str) -> Iterator[OneLane]:
    """Yield the lanes of a world over a soil."""
    if world == "solved":
        for number in RATES["solved"][soil]:
            (lane,) = of_row(f"solved-{number}")
            run = open_run(lane.stored[0])
            # The declaration says which lanes are of which soil; it must be that of the rows.
            solved = run.attrs["fullwave"]["soil"][0]["permittivity"]
            trained = of_row(RATES["soils"][soil][0])[0].scene.soil.permittivity
            if not np.isclose(solved, trained):
                raise ValueError(
                    f"solved lane {number} must be of permittivity {trained}, got {solved}"
                )
            yield OneLane(lane.name, run, lane.lane, lane.truth())
        return
    rows = RATES["soils"][soil]
    first = RATES[world]["first"] + list(RATES["soils"]).index(soil) * RATES[world]["per_soil"]
    for number in range(RATES[world]["per_soil"]):
        lane = of_row(rows[number % len(rows)])[0]
        sensor = lane.sensor
        if world == "echo":
            from full_wave_twins import with_echo

            sensor = with_echo(sensor)
        seed = first + number
        run = Simulator(lane.scene, sensor, seed).run()
        truth = draw_world(lane.scene, seed).truth()
        yield OneLane(f"{world}-{soil}-{seed}", run, lane.lane, truth)


def model_without(out: Path, soil: str) -> Path:
    """Train the fitted recipe on the ground's training lanes of the other soils."""
    out.mkdir(parents=True, exist_ok=True)
    model = out / f"model-without-{soil}"
    (out / "fused.toml").write_text(packaged_entries(ground())["fused"].text, encoding="utf-8")
    others = [rows for other, rows in RATES["soils"].items() if other != soil]
    lanes = [lane for rows in others for row in rows for lane in of_row(row)]
    runs, truths = made_lanes(out, lanes)
    if not model.exists():
        train(runs, truths, out / "fused.toml", model, label_radius=RATES["halo"])
    return model


def run(out: Path, world: str) -> None:
    """Detect on the lanes of every soil by the model that never saw it."""
    for soil in RATES["soils"]:
        model = load_model(model_without(out, soil))
        recipe = parse_recipe((out / "fused.toml").read_text("utf-8"))
        for lane in lanes_of(world, soil):
            for ranked, unlike in (("kept", "keep"), ("delivered", "fallback")):
                path = out / f"{world}.{soil}.{lane.name}.{ranked}.csv"
                if path.exists():
                    continue
                found = detect(lane.run, recipe, lane.lane, model=model, unlike=unlike)
                write_table(lane.truth, out / f"{world}.{soil}.{lane.name}.truth.csv")
                write_table(found.alarms, path)


def threshold_of(model: Model, alarms: pd.DataFrame, lane: Lane, nominal: float) -> float:
    """Return the threshold that `flgpr detect --far` states."""
    if AS_LEARNT in alarms:
        inside = lane.contains(alarms["x"], alarms["y"])
        confidence = alarms["confidence"].to_numpy()[inside]
        return own_threshold(confidence, lane.area, nominal).threshold
    return training_threshold(model.ground.free, nominal).threshold


def realised(out: Path) -> pd.DataFrame:
    """Return for every lane, ranking and nominal rate the false alarms and the mines found."""
    rows: list[dict[str, Any]] = []
    borders = of_row("dry")[0].lane
    models = {soil: load_model(out / f"model-without-{soil}") for soil in RATES["soils"]}
    for path in sorted(out.glob("*.*.*.*.csv")):
        world, soil, name, ranked = path.name.removesuffix(".csv").split(".")
        if ranked not in RANKED:
            continue
        alarms = read_table(path, "alarms")
        truth = read_table(out / f"{world}.{soil}.{name}.truth.csv", "truth")
        matched = match(
            alarms.assign(lane=name), truth.assign(lane=name), {name: borders}, RATES["halo"]
        )
        _, best, _ = matched.best()
        for nominal in (*RATES["nominal"], *NOMINAL):
            level = threshold_of(models[soil], alarms, borders, nominal)
            rows.append(
                {
                    "world": world,
                    "lane": name,
                    "ranked": ranked,
                    "spoke": AS_LEARNT in alarms,
                    "nominal": float(nominal),
                    "false": int((matched.false & (matched.confidence > level)).sum()),
                    "area": borders.area,
                    "found": int((best > level).sum()),
                    "mines": len(truth),
                }
            )
    table = pd.DataFrame(rows)
    return table.assign(realised=table["false"] / table["area"])


def print_tables(table: pd.DataFrame) -> None:
    """Print on how many lanes the nominal rates are kept."""
    rows = []
    for world, words in WORLDS.items():
        for ranked, ranking in RANKED.items():
            of_world = table[(table["world"] == world) & (table["ranked"] == ranked)]
            for nominal in RATES["nominal"]:
                some = of_world[of_world["nominal"] == nominal]
                if not len(some):
                    continue
                kept = int((some["realised"] <= nominal + 1e-9).sum())
                mean = some["false"].sum() / some["area"].sum()
                found = f"{some['found'].sum()} of {some['mines'].sum()}"
                spoke = str(int(some["spoke"].sum())) if ranked == "delivered" else ""
                within = with_share(kept, len(some))
                rows.append([words, ranking, spoke, f"{nominal:g}", within, f"{mean:.3f}", found])
    head = [
        "lanes",
        "ranking",
        "spoke",
        "nominal, per m²",
        "lanes within it (95 % interval)",
        "realised over all, per m²",
        "mines above",
    ]
    print(markdown(head, rows))


def draw(table: pd.DataFrame, path: Path) -> None:
    """Draw the realised rate against the nominal one: mean of the lanes, and what 95 % of them keep below."""
    worlds = [world for world in WORLDS if (table["world"] == world).any()]
    figure = Figure(figsize=(3.4 * len(worlds) + 0.6, 4.0), layout="constrained")
    panels = np.atleast_1d(figure.subplots(1, len(worlds), sharey=True))
    for axes, world in zip(panels, worlds, strict=True):
        for ranked, colour in (("kept", "tab:red"), ("delivered", "tab:blue")):
            some = table[(table["world"] == world) & (table["ranked"] == ranked)]
            some = some[some["nominal"].isin(NOMINAL)]
            grouped = some.groupby("nominal")["realised"]
            high = grouped.quantile(0.95, interpolation="higher")
            axes.plot(
                high.index,
                high,
                "-",
                drawstyle="steps-post",
                color=colour,
                label=f"95 % of lanes, {RANKED[ranked]}",
            )
            axes.plot(
                high.index, grouped.mean(), ":", color=colour, label=f"mean, {RANKED[ranked]}"
            )
        axes.plot(NOMINAL, NOMINAL, "k--", lw=1, label="realised = nominal")
        lanes = table[table["world"] == world]["lane"].nunique()
        axes.set(xlabel="nominal, per m²", title=f"{WORLDS[world]} ({lanes})")
        axes.set_ylim(-0.02, 0.5)
        axes.title.set_fontsize(9)
        axes.grid(alpha=0.3)
    panels[0].set_ylabel("realised, false alarms per m²")
    panels[0].legend(fontsize=7, loc="upper left")
    figure.savefig(path, dpi=110)


def main() -> None:
    """Run a step."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("step", choices=("run", "tables"))
    parser.add_argument("out", type=Path)
    parser.add_argument("world", nargs="?", choices=tuple(WORLDS))
    parser.add_argument("--figure", type=Path)
    given = parser.parse_args()
    if given.step == "run":
        run(given.out, given.world)
        return
    table = realised(given.out)
    print_tables(table)
    if given.figure is not None:
        draw(table, given.figure)


if __name__ == "__main__":
    main()
