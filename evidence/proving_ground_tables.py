"""Make the tables and the figures of docs/evidence/proving-ground.md from the folder of a full run.

    python evidence/proving_ground_tables.py FOLDER [docs/evidence/benchmark [docs/images [src/flgpr_ground]]]

Writes for every tier of the ground ``TIER.csv`` (Pd of every entry in the standard split at the false alarm rate of
comparison, and how many mines it finds at other rates), ``TIER-splits.csv`` (mines by kind and site, Pd in the other
splits) and ``TIER-bodies.csv`` (targets found of every body), and the opening figure. For leaderboards it writes what
all entries find at the false alarm rate of comparison into the package, ``scores-GROUND.csv`` and
``costs-GROUND.csv``. Nothing is opened that is sealed. The cost of an entry whose run was resumed after a stop counts
the last part alone: write it by hand, or leave it empty.
"""

from __future__ import annotations

import sys
from pathlib import Path

import pandas as pd

from flgpr.store.tables import read_columns
from flgpr_ground.figures import tiers_figure
from flgpr_ground.ground import Ground, scores_at
from flgpr_ground.lanes import read_ground
from flgpr_ground.table import paired_in_words

STANDARD = "standard"
REFERENCE = "wang2007"
ORACLES = ("oracle-phase", "oracle")
OTHER_RATES = (0.001, 0.005, 0.05)
ABSENT = "·"
KINDS = ("metal", "plastic", "ap")
PACKAGED_COLUMNS = [
    "tier", "entry", "split", "group", "far_allowed", "chance", "n_detected", "n_targets", "n_false", "area",
    "only", "reference_only", "p",
]  # fmt: skip


def main() -> None:
    """Write the tables and the figures."""
    folder = Path(sys.argv[1])
    tables = Path(sys.argv[2] if len(sys.argv) > 2 else "docs/evidence/benchmark")
    images = Path(sys.argv[3] if len(sys.argv) > 3 else "docs/images")
    package = Path(sys.argv[4] if len(sys.argv) > 4 else "src/flgpr_ground")
    ground = read_ground(folder)
    scores = read_columns(folder / "scores.csv")
    costs = read_columns(folder / "costs.csv")
    for tier in ground.table.tiers:
        scored = scores[scores["tier"] == tier]
        if scored.empty:
            continue
        cost = costs[costs["tier"] == tier].set_index("entry")["seconds_per_km"]
        entries = in_order(scored, ground)
        standard_table(scored, cost, entries, ground).to_csv(tables / f"{tier}.csv", index=False)
        splits_table(scored, entries, ground).to_csv(tables / f"{tier}-splits.csv", index=False)
        bodies_table(scored, entries, ground).to_csv(tables / f"{tier}-bodies.csv", index=False)
    tiers_figure(ground, scores).savefig(images / "benchmark-tiers.png", dpi=130)
    packaged = packaged_scores(scores, ground)
    packaged.to_csv(package / f"scores-{ground.title}.csv", index=False, float_format="%.6g")
    costs.drop(columns="peak_bytes").to_csv(package / f"costs-{ground.title}.csv", index=False)


def packaged_scores(scores: pd.DataFrame, ground: Ground) -> pd.DataFrame:
    """Return the counts of mines in every split, and of the kinds of mines in the standard one."""
    of_mines = scores["group"] == "mines"
    of_kinds = scores["group"].isin(KINDS) & (scores["split"] == STANDARD)
    at_far = scores["far_allowed"] == ground.table.far
    return scores.loc[at_far & (of_mines | of_kinds), PACKAGED_COLUMNS]


def in_order(scores: pd.DataFrame, ground: Ground) -> list[str]:
    """Return the oracles, then the entries by the mines they find in the standard split."""
    found = scores_at(scores, ground, STANDARD).set_index("entry")["n_detected"]
    ordered = found.sort_values(ascending=False, kind="stable").index
    oracles = [name for name in ORACLES if name in found.index]
    return oracles + [str(name) for name in ordered if name not in ORACLES]


def standard_table(
    scores: pd.DataFrame, cost: pd.Series, entries: list[str], ground: Ground
) -> pd.DataFrame:
    """Return what every entry finds in the standard split, against chance and the reference."""
    at_far = scores_at(scores, ground, STANDARD).set_index("entry")
    other = {
        far: scores_at(scores, ground, STANDARD, far=far).set_index("entry")["n_detected"]
        for far in OTHER_RATES
    }
    rows = []
    for entry in entries:
        row = at_far.loc[entry]
        cells = {
            "entry": entry,
            "Pd, 95 % interval": f"{row.pd:.2f} ({row.pd_low:.2f} to {row.pd_high:.2f})",
            "mines": f"{row.n_detected:.0f} of {row.n_targets:.0f}",
            "chance": f"{row.chance:.2f}",
        }
        for far, found in other.items():
            cells[f"at {far:g}"] = f"{found[entry]:.0f}" if entry in found.index else ABSENT
        against = paired_in_words(row) or ABSENT
        cells[f"against {REFERENCE}"] = "reference" if entry == REFERENCE else against
        seconds = cost.get(entry, float("nan"))
        cells["processor s per km"] = ABSENT if pd.isna(seconds) else f"{seconds:.0f}"
        rows.append(cells)
    return pd.DataFrame(rows)


def splits_table(scores: pd.DataFrame, entries: list[str], ground: Ground) -> pd.DataFrame:
    """Return mines found by kind and site in the standard split, and Pd in the other splits."""
    columns = {}
    for group in ("metal", "plastic", "ap", *ground.sites):
        found = scores_at(scores, ground, STANDARD, group).set_index("entry")
        title = f"{group} of {found['n_targets'].max():.0f}"
        columns[title] = found["n_detected"].reindex(entries).map("{:.0f}".format)
    for split in ground.table.splits:
        if split != STANDARD:
            pd_of_split = scores_at(scores, ground, split).set_index("entry")["pd"].reindex(entries)
            columns[split] = pd_of_split.map(two_places)
    by_site = scores_at(scores, ground, "new-site").set_index("entry")["pd_mean"].reindex(entries)
    columns["new-site, each site by itself"] = by_site.map(two_places)
    return pd.DataFrame(columns).rename_axis("entry").reset_index()


def two_places(value: float) -> str:
    """Return a Pd with two decimals, or the sign for none."""
    return ABSENT if pd.isna(value) else f"{value:.2f}"


def bodies_table(scores: pd.DataFrame, entries: list[str], ground: Ground) -> pd.DataFrame:
    """Return how many targets of every packaged body an entry finds in the standard split."""
    columns = {}
    for group in dict.fromkeys(scores["group"]):
        if group.startswith("body ") or group == "simulant":
            found = scores_at(scores, ground, STANDARD, group).set_index("entry")
            title = f"{group.removeprefix('body ')} of {found['n_targets'].max():.0f}"
            columns[title] = found["n_detected"].reindex(entries).map("{:.0f}".format)
    return pd.DataFrame(columns).rename_axis("entry").reset_index()


if __name__ == "__main__":
    main()
