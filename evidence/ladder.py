"""What each piece of knowledge is worth to a detector: oracles that lose one at a time, on both tiers.

``python evidence/ladder.py GROUND OUT [--tier T] [--site S] [--figure FILE.png]`` looks at the lanes of a
folder of ``flgpr benchmark run`` and opens its sealed truth, which is entered in the log OUT/looks.jsonl. What is in
OUT already is not computed again. ``--summary`` only makes the tables and the figure again. No detector is chosen or
tuned by it.

What every rung knows stands in `ladder_rungs.py`. A statistic is tried on all places of the site's target-free lane;
local maxima that reach the mine's value are the false alarms with which it is found (flgpr_ground.oracle). It
is no bound where false alarms are many.
"""

from __future__ import annotations

import argparse
import math
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

sys.path.append(str(Path(__file__).parent))
import ladder_rungs as rungs
from common import far_at, markdown, matched
from flgpr.model import ground_points
from flgpr.scoring import assign, clopper_pearson, mcnemar_test
from flgpr.simulate import draw_world
from flgpr.store.tables import read_columns
from flgpr.trials import open_truth
from flgpr_ground.ground import Ground
from flgpr_ground.lanes import SEALED, passphrase, read_ground
from flgpr_ground.oracle import BareGround, cleaned_lane, lanes_of_site, looks_at_mines
from flgpr_ground.running import ALARMS, entry_folder

RUNGS = {
    "phases": "and the phases between looks",
    "oracle": "all but the phases",
    "level unknown": "without the level",
    "hole unknown": "without the hole",
    "tilt unknown": "without the tilt",
    "roughness unknown": "without the roughness",
    "cover unknown": "without grass and shadows",
    "flat ground": "without any of these four",
    "depth and soil unknown": "without depth and soil",
    "body unknown": "without the body",
    "white clutter": "without correlations of clutter",
    "metal signatures": "metal signatures, all depths and soils",
    "metal, white clutter": "the same, white clutter",
    "metal, white, level unknown": "the same, level unknown",
    "one look": "one look",
}
ENTRIES = {"fused": "fused", "wang2007": "C_HH (wang2007)"}
PARTS = ("bodies", "position")
KINDS = {"bodies": ("full", "diagonal"), "position": ("full",)}  # of clutter, by part
LEVELS = (0.5, 0.7)  # of Pd
FAR = 0.02  # per m²
RECIPE = "wang2007"  # whose images are looked at
GROUPS = ("mines", "metal", "plastic", "ap")


# All mines of the ground


def name_of(ground: Ground) -> str:
    """Return the name of a tier, or of a ground without tiers."""
    return ground.tier or "ground"


def site_file(out: Path, ground: Ground, site: str, part: str) -> Path:
    """Return the file of what a part of the rungs finds at a site."""
    ending = "" if part == "bodies" else f"-{part}"
    return out / f"ladder-{name_of(ground)}-{site}{ending}.csv"


def look_at_site(
    ground: Ground,
    folder: Path,
    site: str,
    part: str,
    truth: pd.DataFrame,
) -> Iterator[dict]:
    """Yield the false alarms per m² of every mine of a site, on every rung of a part."""
    bare, tested = lanes_of_site(ground, site)
    if bare is None:
        return
    start = time.process_time()
    ground_looks = BareGround(cleaned_lane(str(folder), bare, RECIPE), bare.lane, KINDS[part])
    print(f"{bare.name}: {time.process_time() - start:.0f} s", flush=True)
    for lane in tested:
        start = time.process_time()
        setup = cleaned_lane(str(folder), lane, RECIPE)
        targets = truth[truth["lane"] == lane.name].reset_index(drop=True)
        looks, own = looks_at_mines(setup, lane, targets)
        hidden = None
        if part == "position":
            hidden = rungs.hidden_echoes(setup, lane, targets)
        print(f"{lane.name}: looks, {time.process_time() - start:.0f} s", flush=True)
        world = draw_world(lane.scene, lane.seed)
        points = ground_points(targets)
        for number, target in enumerate(targets.to_dict("records")):
            at = looks.place == number
            row = {"tier": name_of(ground), "site": site, "target_id": target["target_id"]}
            row |= {"kind": target["kind"], "body": target.get("body", ""), "looks": int(at.sum())}
            if hidden is not None:
                echoes = np.concatenate([own[at][:, None], hidden[at]], axis=1)
                row |= rungs.rates(
                    ground_looks, rungs.POSITION_PART, looks.ahead[at], looks.chip[at], echoes
                )
            else:
                mine = world.targets[int(target["target_id"].rpartition("-T")[2]) - 1]
                others = rungs.candidate_echoes(setup, lane, mine, points[number])
                echoes = np.concatenate([own[at][:, None], others], axis=1)
                row |= rungs.body_rates(ground_looks, looks.ahead[at], looks.chip[at], echoes)
            yield row
        print(f"{lane.name}: {time.process_time() - start:.0f} s", flush=True)


def read_site(files: dict[str, Path]) -> pd.DataFrame:
    """Return the table of a site: that of bodies, with the rungs of its position beside it.

    Raises
    ------
    ValueError
        If the oracle of the two differs, as it does when they are of different lanes.
    """
    table = read_columns(files["bodies"])
    if not files["position"].is_file():
        return table
    others = read_columns(files["position"]).set_index("target_id")
    others = others.reindex(table["target_id"]).reset_index()
    if not np.allclose(others["oracle"], table["oracle"], equal_nan=True):
        raise ValueError(
            f"the oracle must be the same in the two files of a site, got others in "
            f"{files['bodies']} and {files['position']}"
        )
    new = [name for name in others if name not in table]
    return pd.concat([table, others[new]], axis=1)


def of_entry(ground: Ground, folder: Path, entry: str, truth: pd.DataFrame) -> dict[str, float]:
    """Return the false alarms per m² with which an entry finds each mine of the standard split."""
    if not (entry_folder(folder, entry, ground) / "standard" / ALARMS).is_file():
        return {}
    found = assign(matched(ground, truth, [folder], entry, "standard"))
    return dict(zip(found["target_id"], found["far"], strict=True))


# Tables and figure


def groups_of(
    table: pd.DataFrame, names: Sequence[str]
) -> Iterator[tuple[str, str, pd.DataFrame, list[str]]]:
    """Yield tier, group, its mines and the columns computed for all of them, for every group of a tier."""
    for tier, of_tier in table.groupby("tier", sort=False):
        for group in GROUPS:
            kind = of_tier["kind"]
            mines = of_tier[kind != "simulant" if group == "mines" else kind == group]
            if len(mines):
                known = [name for name in names if name in table and mines[name].notna().all()]
                yield tier, group, mines, known


def summary(table: pd.DataFrame) -> pd.DataFrame:
    """Return false alarms at a Pd and mines found at a rate, with intervals, by tier and kind.

    The intervals of false alarms are the bootstrap's over mines (2000 samples, 95 %), those of
    counts exact.
    """
    rows = []
    rng = np.random.default_rng(51)
    for tier, group, mines, columns in groups_of(table, (*RUNGS, *ENTRIES)):
        samples = rng.integers(0, len(mines), (2000, len(mines)))
        for column in columns:
            far = mines[column].to_numpy()
            row = {"tier": tier, "group": group, "rung": column, "mines": len(mines)}
            for level in LEVELS:
                drawn = np.sort([far_at(far[sample], level) for sample in samples])
                row[f"far_at_{level:g}"] = far_at(far, level)
                row[f"low_{level:g}"] = drawn[49]
                row[f"high_{level:g}"] = drawn[1949]
            found = int((far <= FAR).sum())
            low, high = clopper_pearson(found, len(far))
            row |= {"found": found, "pd": found / len(far), "pd_low": low, "pd_high": high}
            rows.append(row)
    return pd.DataFrame(rows)


def paired(table: pd.DataFrame) -> pd.DataFrame:
    """Return how many mines every rung loses and gains against the oracle, by tier and kind.

    ``lost`` are mines that the oracle finds at 0.02 false alarms per m² and the rung does not, ``gained`` the reverse;
    ``p`` is that of McNemar's exact test. ``share_low`` and ``share_high`` are the exact 95 % interval of lost mines
    among those that the oracle finds.
    """
    rows = []
    for tier, group, mines, columns in groups_of(
        table, [name for name in RUNGS if name != "oracle"]
    ):
        by_oracle = mines["oracle"] <= FAR
        for column in columns:
            by_rung = mines[column] <= FAR
            lost = int((by_oracle & ~by_rung).sum())
            gained = int((by_rung & ~by_oracle).sum())
            row = {"tier": tier, "group": group, "rung": column, "mines": len(mines)}
            row |= {"oracle": int(by_oracle.sum()), "lost": lost, "gained": gained}
            row["p"] = mcnemar_test(lost, gained)
            low, high = math.nan, math.nan
            if by_oracle.any():
                low, high = clopper_pearson(lost, int(by_oracle.sum()))
            rows.append(row | {"share_low": low, "share_high": high})
    return pd.DataFrame(rows)


def page_tables(rows: pd.DataFrame, losses: pd.DataFrame) -> str:
    """Return the two tables of docs/evidence/ladder: mines found, and what is lost against the oracle.

    What was not computed at all sites of a tier has an empty cell.
    """
    found = _page_table(rows, "knows", "mines", "{tier}, {group} of {total}", _found_cell)
    title = "{tier}, {group}: lost of {total}"
    return f"{found}\n\n{_page_table(losses, 'oracle', 'oracle', title, _lost_cell)}"


def _page_table(
    rows: pd.DataFrame, corner: str, total: str, title: str, cell: Callable[[dict], str]
) -> str:
    """Return a Markdown table with a row for each rung, and a column for each tier and kind."""
    names = {**RUNGS, **ENTRIES}
    cells = {}
    titles = {}
    for row in rows.to_dict("records"):
        column = (row["tier"], row["group"])
        titles[column] = title.format(tier=row["tier"], group=row["group"], total=row[total])
        cells[row["rung"], column] = cell(row)
    present = set(rows["rung"])
    body = []
    for rung, words in names.items():
        if rung in present:
            body.append([words, *(cells.get((rung, column), "") for column in titles)])
    return markdown([corner, *titles.values()], body)


def _found_cell(row: dict) -> str:
    """Return how many mines a rung finds, for all mines with the interval."""
    spread = f" ({row['pd_low']:.2f} to {row['pd_high']:.2f})" if row["group"] == "mines" else ""
    return f"{row['found']}{spread}"


def _lost_cell(row: dict) -> str:
    """Return how many mines a rung loses and gains, for all mines with interval and p."""
    gained = f", +{row['gained']}" if row["gained"] else ""
    if row["group"] != "mines":
        return f"{row['lost']}{gained}"
    share = f"{row['share_low']:.2f} to {row['share_high']:.2f}"
    return f"{row['lost']} ({share}){gained}; p = {row['p']:.2g}"


def draw(rows: pd.DataFrame, least: float, path: Path) -> None:
    """Draw false alarms at Pd 0.5, and mines found at 0.02 per m², by rung, on both tiers."""
    figure = Figure(figsize=(13, 6.2), layout="constrained")
    panels = figure.subplots(1, 3, sharey=True)
    names = {**RUNGS, **ENTRIES}
    order = [name for name in names if (rows["rung"] == name).any()]
    tiers = list(dict.fromkeys(rows["tier"]))
    styles = dict(zip(tiers, (("o", "C0", 0.15), ("s", "C1", -0.15)), strict=False))
    for panel, (group, quantity) in zip(
        panels, (("metal", "far"), ("plastic", "far"), ("mines", "pd")), strict=True
    ):
        for tier, (marker, colour, shift) in styles.items():
            some = rows[(rows["tier"] == tier) & (rows["group"] == group)].set_index("rung")
            if not len(some):
                continue
            some = some.reindex(order)
            place = -np.arange(len(order)) + shift
            if quantity == "pd":
                low, value, high = some["pd_low"], some["pd"], some["pd_high"]
            else:
                floor = least / 2  # none over the ground
                low, value, high = (
                    some[column].clip(floor, 3.0)
                    for column in ("low_0.5", "far_at_0.5", "high_0.5")
                )
            panel.hlines(place, low, high, color=colour, lw=1.3)
            fill = colour if marker == "o" else "white"
            panel.plot(value, place, marker, color=colour, mfc=fill, ms=5, label=tier)
        if quantity == "far":
            panel.set(xscale="log", xlabel="false alarms per m² at Pd 0.5", title=group)
            panel.axvline(least, color="0.7", ls=":", lw=1)
        else:
            panel.set(xlim=(0, 1), xlabel="Pd at 0.02 false alarms per m²", title="all mines")
        panel.grid(axis="x", alpha=0.3)
    panels[0].set_yticks(-np.arange(len(order)), [names[name] for name in order])
    panels[2].legend(fontsize=9)
    figure.savefig(path, dpi=85, metadata={"Software": None})


def main(arguments: list[str] | None = None) -> None:
    """Climb the ladder, or tell of what was found."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("ground", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--tier")
    parser.add_argument("--site", action="append")
    parser.add_argument("--summary", action="store_true")
    parser.add_argument("--figure", type=Path)
    given = parser.parse_args(arguments)
    tiers = read_ground(given.ground).chosen_tiers(given.tier)
    sites = sorted({site for ground in tiers for site in ground.sites})
    for site in given.site or []:
        if site not in sites:
            parser.error(f"--site must be one of {', '.join(sites)}, got {site}")
    given.out.mkdir(parents=True, exist_ok=True)
    log = given.out / "looks.jsonl"
    truth = open_truth(given.ground / "lanes" / SEALED, passphrase(tiers[0]), log)[0]
    files = []
    for ground in tiers:
        for site in ground.sites:
            if given.site and site not in given.site:
                continue
            of_site = {part: site_file(given.out, ground, site, part) for part in PARTS}
            files.append(of_site)
            for part, file in of_site.items():
                if given.summary or file.is_file():
                    continue
                rows = look_at_site(ground, given.ground, site, part, truth)
                pd.DataFrame(list(rows)).to_csv(file, index=False, float_format="%.6g")
    tables = [read_site(of_site) for of_site in files if of_site["bodies"].is_file()]
    table = pd.concat(tables, ignore_index=True)
    for ground in tiers:
        for entry in ENTRIES:
            found = of_entry(ground, given.ground, entry, truth)
            own = table["tier"] == name_of(ground)
            if found:
                table.loc[own, entry] = table.loc[own, "target_id"].map(found)
    rows = summary(table)
    rows.to_csv(given.out / "ladder.csv", index=False, float_format="%.5g")
    losses = paired(table)
    losses.to_csv(given.out / "ladder-paired.csv", index=False, float_format="%.5g")
    bare = [lane for ground in tiers for lane in ground.lanes.values() if lane.empty]
    least = 1 / min((lane.lane.area for lane in bare), default=math.inf)
    print(page_tables(rows, losses))
    if given.figure is not None:
        draw(rows, least, given.figure)


if __name__ == "__main__":
    main()
