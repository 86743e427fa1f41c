"""After the result of the ground full-wave-2 was known: variants of `fused` on its solved lanes, and the figure.

``python evidence/full_wave_2_after.py variants OUT [--ground full-wave-1]`` runs recipes that were made because of
that result, so what they find shows a cause and is no result of its own:

- `fused-early`: the stage `early` takes out what arrives before the nearest pixel of the images;
- `fused-near`: images begin 1.2 m ahead, as those of `miniature` do, and not 1.8 m ahead;
- `fused-near-early`: both;
- `fused-wide`: both, in the sub-bands of `miniature`;
- `wang2007-early`: C_HH with the stage `early`.

``python evidence/full_wave_2_after.py tables GROUND OUT [--csv FILE] [--figure FILE]`` prints how many mines of each
body and row were found in GROUND, where the twelve entries ran, and in OUT, at the false alarm rate of comparison,
writes the table of the entries, and draws the lanes. It opens the sealed truth of GROUND, which is logged.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle

sys.path.append(str(Path(__file__).parent))
from common import markdown, matched
from flgpr.method.method import detect
from flgpr.proving_ground import load_ground, packaged_entries, run_benchmark, write_score_tables
from flgpr.recipe.schema import parse_recipe
from flgpr.scoring import operating_row, roc_of
from flgpr.store import open_run, read_table
from flgpr.store.tables import read_columns
from flgpr.trials import open_truth
from flgpr_ground.ground import Ground, GroundLane
from flgpr_ground.running import SEALED, passphrase
from flgpr_ground.table import paired_in_words

GROUND = "full-wave-2"
SPLIT = "full-wave"
FIRST_ROW = 0.525  # y of the first row of targets, m
ROWS_APART = 1.05  # m
BODIES = {
    "metal-at": ("metal", "tab:red"),
    "tm-62p": ("plastic, metal fuze", "tab:orange"),
    "plastic-at": ("plastic, gap", "tab:cyan"),
    "plastic-at-solid": ("plastic, solid", "tab:green"),
}
REPLACED = {
    "early": [("[background]\n", '[[clutter]]\nstage = "early"\n\n[background]\n')],
    "near": [("y = [1.8, 8.45]", "y = [1.2, 8.45]")],
    "wide": [
        ("B0 = [0.45e9, 0.6e9]", "B0 = [0.45e9, 1.05e9]"),
        ("B1 = [0.6e9, 0.8e9]", "B1 = [0.45e9, 1.5e9]"),
        ("B2 = [0.8e9, 1.05e9]", "B2 = [0.9e9, 1.5e9]"),
    ],
}
VARIANTS = {
    "fused-early": ("fused", ["early"]),
    "fused-near": ("fused", ["near"]),
    "fused-near-early": ("fused", ["near", "early"]),
    "fused-wide": ("fused", ["near", "early", "wide"]),
    "wang2007-early": ("wang2007", ["early"]),
}


def variant_text(text: str, changes: list[str]) -> str:
    """Return the text of a recipe with changes; each changes what stands once."""
    for change in changes:
        for old, new in REPLACED[change]:
            if text.count(old) != 1:
                raise ValueError(f"recipe must hold {old!r} once, got {text.count(old)}")
            text = text.replace(old, new)
    return text


def run_variants(out: Path, ground: str) -> None:
    """Run all variants on the lanes of a ground, and print their scores."""
    entries = packaged_entries(load_ground(source=ground))
    recipes = out / "recipes"
    recipes.mkdir(parents=True, exist_ok=True)
    paths = ["wang2007", "fused"]
    for name, (entry, changes) in VARIANTS.items():
        path = recipes / f"{name}.toml"
        path.write_text(variant_text(entries[entry].text, changes), encoding="utf-8")
        paths.append(str(path))
    run_benchmark(paths, out / "ground", ground=ground)
    print(write_score_tables([out / "ground"], out / "ground"))


def found_by(ground: Ground, truth: pd.DataFrame, folder: Path, entry: str) -> pd.DataFrame:
    """Return the targets with what an entry finds of them at the rate of comparison."""
    result = matched(ground, truth, [folder], entry, SPLIT)
    curve = roc_of(result)
    threshold = curve.iloc[operating_row(curve, np.array([ground.table.far]))]["threshold"].item()
    _, confidence, _ = result.best()
    is_raised = result.false & (result.confidence >= threshold)
    table = result.truth.assign(found=confidence >= threshold)
    table.attrs["false"] = result.alarms[is_raised]
    return table


def entries_of(folder: Path) -> list[str]:
    """Return the entries that ran in a folder."""
    return sorted(path.name for path in (folder / "entries").iterdir())


def print_tables(found: dict[str, pd.DataFrame]) -> None:
    """Print mines found of each body and in each row."""
    names = [words for words, _ in BODIES.values()]
    rows = []
    ranked = sorted(found.items(), key=lambda item: -item[1]["found"].sum())
    for entry, table in ranked:
        row = np.rint((table["y"] - FIRST_ROW) / ROWS_APART)
        by_body = table.groupby("body")["found"].sum()
        by_row = table.groupby(row)["found"].sum()
        cells = [entry, str(table["found"].sum())]
        cells += [str(by_body[body]) for body in BODIES]
        cells += [", ".join(map(str, by_row)), str(len(table.attrs["false"]))]
        rows.append(cells)
    print(markdown(["entry", "mines", *names, "in rows 1 to 4", "false alarms"], rows))


def write_score_table(ground: Ground, folder: Path, path: Path) -> None:
    """Write what the entries of a folder find, the best first, with intervals, chance and paired tests."""
    scores = read_columns(folder / "scores.csv")
    scores = scores[scores["split"] == SPLIT]
    rows = []
    for entry, of_entry in scores.groupby("entry"):
        counts = of_entry.set_index(["group", "far_allowed"])["n_detected"]
        mines = of_entry[of_entry["group"] == "mines"].set_index("far_allowed")
        point = mines.loc[ground.table.far]
        row = {
            "entry": entry,
            "Pd, 95 % interval": f"{point['pd']:.2f} ({point['pd_low']:.2f} to {point['pd_high']:.2f})",
            "mines": f"{point['n_detected']:.0f} of {point['n_targets']:.0f}",
            "chance": f"{point['chance']:.2f}",
        }
        for far in ground.table.fars:
            if far != ground.table.far:
                row[f"at {far:g}"] = f"{mines.loc[far, 'n_detected']:.0f}"
        for body, (words, _) in BODIES.items():
            row[words] = f"{counts[f'body {body}', ground.table.far]:.0f}"
        row["against wang2007"] = paired_in_words(point)
        if entry == ground.table.reference:
            row["against wang2007"] = "reference"
        rows.append((-point["n_detected"], row))
    rows.sort(key=lambda item: item[0])
    pd.DataFrame([row for _, row in rows]).to_csv(path, index=False)


def draw(ground: Ground, found: dict[str, pd.DataFrame], path: Path) -> None:
    """Draw the solved lanes: the image of C_HH, what lies there, and what two recipes find."""
    figure = Figure(figsize=(8.5, 10.4), layout="constrained")
    lanes = ground.tested(SPLIT)
    recipe = parse_recipe(packaged_entries(ground)["wang2007"].text)
    picture = None
    panels = figure.subplots(2, len(lanes) // 2, sharex=True, sharey=True)
    for axes, lane in zip(panels.flat, lanes, strict=True):
        run = open_run(lane.stored[0])
        view = np.abs(detect(run, recipe, lane.lane).view.sel(polarization="HH", subband="F0"))
        decibels = 20 * np.log10(view.where(view > 0))
        picture = axes.pcolormesh(view["x"], view["y"], decibels, cmap="gray", vmin=-10, vmax=20)
        draw_lane(axes, lane, found)
        soil = run.attrs["fullwave"]["soil"][0]["permittivity"]
        roughness = 1000 * run.attrs["fullwave"]["surface"]["rms_height"]
        axes.set_title(f"ε {soil:.1f}, {roughness:.0f} mm rough")
        axes.set(xlim=(-1.15, 1.15), ylim=(0, 4.3), aspect="equal")
    figure.supylabel("y, m; the vehicle comes from below")
    for axes in panels[-1]:
        axes.set_xlabel("x, m")
    figure.colorbar(picture, ax=figure.axes, label="C_HH image over its background, dB", shrink=0.5)
    figure.legend(handles=legend_handles(), loc="outside lower center", ncols=4, fontsize=9)
    figure.savefig(path, dpi=100)


def draw_lane(axes: Axes, lane: GroundLane, found: dict[str, pd.DataFrame]) -> None:
    """Draw what lies in a lane, and what is found of it."""
    by_contrast = found["wang2007"]
    own = by_contrast["lane"] == lane.name
    by_likelihood = found["fused"]["found"][own]
    by_variant = found["fused-near-early"]["found"][own]
    for row, target in by_contrast[own].iterrows():
        _, colour = BODIES[target["body"]]
        line = "-" if target["found"] else ":"
        place = (target["x"], target["y"])
        axes.add_patch(Circle(place, 0.2, fill=False, color=colour, linestyle=line, linewidth=2))
        if by_likelihood[row]:
            axes.plot(*place, "o", color="white", markersize=8, markeredgecolor="black")
        if by_variant[row]:
            axes.plot(*place, "+", color="tab:blue", markersize=9, markeredgewidth=2)
    objects = read_table(lane.stored[1].with_name("objects.csv"), "objects")
    for kind, marker in (("rock", "^"), ("stone", "s")):
        of_kind = objects[objects["kind"] == kind]
        axes.plot(of_kind["x"], of_kind["y"], marker, color="tab:purple", markersize=5)
    raised = by_contrast.attrs["false"]
    raised = raised[raised["lane"] == lane.name]
    axes.plot(raised["x"], raised["y"], "x", color="yellow", markersize=8, markeredgewidth=2)


def legend_handles() -> list[Line2D]:
    """Return what the legend explains."""
    handles = []
    for words, colour in BODIES.values():
        handles.append(Line2D([], [], color=colour, linewidth=2, label=words))
    none = {"linestyle": "none"}
    handles += [
        Line2D([], [], color="0.3", linewidth=2, label="found by C_HH"),
        Line2D([], [], color="0.3", linewidth=2, linestyle=":", label="missed by C_HH"),
        Line2D([], [], color="y", marker="x", label="false alarm of C_HH", **none),
        Line2D([], [], color="tab:purple", marker="^", label="rock", **none),
        Line2D([], [], color="tab:purple", marker="s", label="buried stone", **none),
        Line2D([], [], color="white", marker="o", markeredgecolor="k", label="found by fused", **none),
        Line2D([], [], color="tab:blue", marker="+", label="found by fused-near-early", **none),
    ]  # fmt: skip
    return handles


def main() -> None:
    """Run the variants, or print the tables and draw the figure."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    steps = parser.add_subparsers(dest="step", required=True)
    variants = steps.add_parser("variants")
    variants.add_argument("out", type=Path)
    variants.add_argument("--ground", default=GROUND)
    tables = steps.add_parser("tables")
    tables.add_argument("ground", type=Path)
    tables.add_argument("out", type=Path)
    tables.add_argument("--csv", type=Path)
    tables.add_argument("--figure", type=Path)
    given = parser.parse_args()
    if given.step == "variants":
        run_variants(given.out, given.ground)
        return
    ground = load_ground(source=GROUND)
    truth, _, _ = open_truth(given.ground / "lanes" / SEALED, passphrase(ground))
    found = {}
    for folder in (given.out / "ground", given.ground):
        for entry in entries_of(folder):
            found[entry] = found_by(ground, truth, folder, entry)
    print_tables(found)
    if given.csv is not None:
        write_score_table(ground, given.ground, given.csv)
    if given.figure is not None:
        draw(ground, found, given.figure)


if __name__ == "__main__":
    main()
