"""Two entries of the proving ground and the oracle: false alarms at a Pd, and how far confidences are log odds.

``python evidence/proving_ground.py fused wang2007 --folder ground/ [--folder other/] [--tier T] [--figure out.png]``
opens the sealed truth of the first folder, which is logged. Prints Markdown tables. A ground with tiers needs the tier.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

sys.path.append(str(Path(__file__).parent))
from common import matched, stated_in
from flgpr.scoring import roc_of
from flgpr.scoring.matching import Match
from flgpr.store.tables import read_columns
from flgpr.trials import open_truth
from flgpr_ground.oracle import oracle_file
from flgpr_ground.running import SEALED, passphrase, read_ground

LEVELS = {"metal": (0.5, 0.6, 0.7, 0.8, 0.9), "plastic": (0.2, 0.3, 0.4, 0.5)}
BINS = np.linspace(0, 1, 11)


def at_pd(far: np.ndarray, pd_: np.ndarray, level: float) -> float:
    """Least FAR at which a curve reaches a Pd; NaN where it never does."""
    reached = pd_ >= level - 1e-9
    return float(far[reached].min()) if reached.any() else np.nan


def oracle_curve(found: pd.DataFrame, kind: str, column: str) -> tuple[np.ndarray, np.ndarray]:
    """FAR and Pd of the oracle."""
    far = np.sort(found.loc[found["kind"] == kind, column].to_numpy())
    return far, np.arange(1, len(far) + 1) / len(far)


def reliability(one: Match, lanes: list[str]) -> tuple[pd.DataFrame, float]:
    """Share of hits among the alarms in some lanes by their stated probability, and the expected calibration error."""
    p, hit, _ = stated_in(one, lanes)
    number = np.clip(np.digitize(p, BINS) - 1, 0, len(BINS) - 2)
    table = pd.DataFrame({"bin": number, "p": p, "hit": hit}).groupby("bin").agg(
        alarms=("p", "size"), stated=("p", "mean"), true=("hit", "mean"), hits=("hit", "sum")
    )  # fmt: skip
    return table, float(
        (table["alarms"] * (table["stated"] - table["true"]).abs()).sum() / table["alarms"].sum()
    )


def main() -> None:
    """Print the tables and draw the figure."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("entries", nargs="+")
    parser.add_argument("--folder", action="append", type=Path, required=True)
    parser.add_argument("--tier")
    parser.add_argument("--figure", type=Path)
    given = parser.parse_args()
    home = given.folder[0]
    tiers = read_ground(home).chosen_tiers(given.tier)
    if len(tiers) > 1:
        parser.error(f"--tier must be one of {', '.join(tier.tier for tier in tiers)}")
    ground = tiers[0]
    truth, _, _ = open_truth(home / "lanes" / SEALED, passphrase(ground))
    oracle_table = home / oracle_file(ground)
    oracle = read_columns(oracle_table) if oracle_table.is_file() else None
    figure = Figure(figsize=(13, 4.2), layout="constrained")
    axes = figure.subplots(1, 3)
    print("| split | kind | who | " + "false alarms per m² at Pd |\n|---|---|---|---|")
    for split in ("standard", "new-site"):
        for panel, (kind, levels) in zip(axes, LEVELS.items(), strict=False):
            for number, entry in enumerate(given.entries):
                one = matched(ground, truth, given.folder, entry, split)
                curve = roc_of(one, (one.truth["kind"] == kind).to_numpy())
                far = curve["far"].to_numpy()
                pd_ = curve["pd"].to_numpy()
                told = ", ".join(f"{level:g}: {at_pd(far, pd_, level):.3f}" for level in levels)
                print(f"| {split} | {kind} | {entry} | {told} |")
                style = "-" if split == "standard" else "--"
                panel.step(
                    np.maximum(far, 2e-4),
                    pd_,
                    style,
                    c=f"C{number}",
                    where="post",
                    label=f"{entry}, {split}",
                )
            if oracle is not None and split == "standard":
                far, pd_ = oracle_curve(oracle, kind, "far")
                told = ", ".join(f"{level:g}: {at_pd(far, pd_, level):.3f}" for level in levels)
                print(f"| {split} | {kind} | oracle | {told} |")
                panel.step(np.maximum(far, 2e-4), pd_, "k:", where="post", label="oracle")
            panel.set(
                xscale="log",
                xlim=(2e-4, 0.6),
                ylim=(0, 1),
                xlabel="false alarms per m²",
                ylabel="Pd",
                title=kind,
            )
            panel.grid(alpha=0.3)
    axes[0].legend(fontsize=8)
    print("\n| split | site | expected calibration error | alarms | hits |\n|---|---|---|---|---|")
    for split, mark in (("standard", "o-"), ("new-site", "s--")):
        one = matched(ground, truth, given.folder, given.entries[0], split)
        for number, site in enumerate((*ground.sites, "all")):
            lanes = [
                lane.name
                for lane in ground.tested(split)
                if site in (lane.site, "all") and not lane.empty
            ]
            table, error = reliability(one, lanes)
            print(
                f"| {split} | {site} | {error:.3f} | {table['alarms'].sum()} | {table['hits'].sum()} |"
            )
            if site == "all":  # the figure has a curve a site
                continue
            enough = table[table["alarms"] >= 10]
            axes[2].plot(enough["stated"], enough["true"], mark, color=f"C{number}", ms=4,
                         label=site if split == "standard" else None)  # fmt: skip
    axes[2].plot([0, 1], [0, 1], "k:", lw=1)
    axes[2].set(xlabel="stated probability of an alarm", ylabel="share of hits", xlim=(0, 1), ylim=(0, 1),
                title=f"{given.entries[0]}: solid trained there, dashed not")  # fmt: skip
    axes[2].legend(fontsize=8)
    axes[2].grid(alpha=0.3)
    if given.figure is not None:
        figure.savefig(given.figure, dpi=110)


if __name__ == "__main__":
    main()
