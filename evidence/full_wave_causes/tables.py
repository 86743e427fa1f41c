"""Tables and figure of the four experiments."""

from __future__ import annotations

import numpy as np
import pandas as pd

from flgpr.scoring import clopper_pearson
from full_wave_causes.detection import ALLOWED
from full_wave_causes.lanes import OWN, SURFACES, WITH_OWN_ECHOES
from full_wave_causes.signatures import BANDS


def of_three(counts: pd.Series) -> str:
    """Tell how many of a lane's targets are found at one false alarm: mean, and how often 0, 1, 2, 3 of them."""
    found = counts.groupby(level="seed").sum()
    shares = [int((found == number).sum()) for number in range(4)]
    low, high = np.percentile(found, [2.5, 97.5])
    spread = "" if len(found) == 1 else f" ({low:.0f} to {high:.0f}; {', '.join(map(str, shares))})"
    return f"{found.mean():.1f}{spread}"


def report_found(table: pd.DataFrame) -> None:
    """Print how many targets are found, and the false alarms before each in the full-wave lane."""
    table = table.assign(found=table["false_alarms"] <= ALLOWED)
    worlds = ["full wave", *SURFACES, WITH_OWN_ECHOES]
    print(
        "\nTargets found at one false alarm, of 3: mean over twins (95 % of them; twins with 0, 1, 2, 3)\n"
    )
    print("| detector | " + " | ".join(worlds) + " |")
    print("|---" * (len(worlds) + 1) + "|")
    for detector, rows in table.groupby("detector", sort=False):
        cells = []
        for world in worlds:
            some = rows[rows["world"] == world]
            cells.append(of_three(some.set_index("seed")["found"]) if len(some) else "")
        print(f"| {detector} | " + " | ".join(cells) + " |")
    print(
        "\nFalse alarms before each target of the full-wave lane; in the twins the median and how often found at one\n"
    )
    print(
        "| detector | full wave | twins, mine 1 | mine 2 | mine 3 | mine 2 behind, m |\n|---|---|---|---|---|---|"
    )
    for detector, rows in table.groupby("detector", sort=False):
        real = rows[rows["world"] == "full wave"].set_index("target")["false_alarms"]
        cells = [", ".join("never" if np.isinf(count) else f"{count:.0f}" for count in real)]
        twins = rows[rows["world"] == OWN]
        for target in real.index:
            counts = twins.loc[twins["target"] == target, "false_alarms"]
            k = int((counts <= ALLOWED).sum())
            low, high = clopper_pearson(k, len(counts))
            cells.append(f"{k} of {len(counts)} ({low:.2f} to {high:.2f})" if len(counts) else "")
        second = real.index[1]
        real_behind = rows.loc[
            (rows["world"] == "full wave") & (rows["target"] == second), "behind"
        ].item()
        behind = twins.loc[twins["target"] == second, "behind"].dropna()
        spread = ""
        if len(behind):
            low, middle, high = np.percentile(behind, [2.5, 50, 97.5])
            spread = f"; twins {middle:.2f} ({low:.2f} to {high:.2f})"
        cells.append(f"{real_behind:.2f}{spread}")
        print(f"| {detector} | " + " | ".join(cells) + " |")


def report_signatures(alone: pd.DataFrame, lane: pd.DataFrame, clutter: pd.DataFrame) -> None:
    """Print what experiment 3 measured."""
    print("\n| echo of a body alone, 18 cases | least | median | most |\n|---|---|---|---|")
    for column in ("coherence", "level_db", "share_full_wave", "share_simulated"):
        low, middle, high = np.percentile(alone[column], [0, 50, 100])
        print(f"| {column} | {low:.3f} | {middle:.3f} | {high:.3f} |")
    for name in ("coherence", "level_db"):
        columns = [
            column for column in alone if column.startswith(f"{name}_") and column != "level_db"
        ]
        low, high = alone[columns].min().min(), alone[columns].max().max()
        print(f"| {name}, single polarization and sub-band | {low:.3f} | | {high:.3f} |")
    print(
        "\nChips at the mines and their own simulated echoes, over scans (twins: median and central 95 %)\n"
    )
    print("| early echoes | target | quantity | full wave, scans | twins |\n|---|---|---|---|---|")
    for (out, target), rows in lane.groupby(["early_out", "target"]):
        for name in ("coherence", "by_chance_95", "level_db", "level_db_HH", "level_db_VV"):
            real = rows.loc[rows["world"] == "full wave", name]
            low, middle, high = np.percentile(rows.loc[rows["world"] == OWN, name], [2.5, 50, 97.5])
            scans = ", ".join(f"{value:.2f}" for value in real)
            print(
                f"| {'out' if out else 'in'} | {target} | {name} | {scans} | {middle:.2f} ({low:.2f} to {high:.2f}) |"
            )
    print("\nGround away from targets, full wave less twins (dB; range over twins)\n")
    print(
        "| early echoes | polarization | "
        + " | ".join(BANDS)
        + " |\n|---|---|"
        + "---|" * len(BANDS)
    )
    for (out, label), rows in clutter.groupby(["early_out", "polarization"]):
        cells = []
        for band in BANDS:
            some = rows[rows["band"] == band]
            real = some.loc[some["world"] == "full wave", "level_db"].item()
            twins = some.loc[some["world"] == OWN, "level_db"]
            cells.append(
                f"{real - twins.mean():.1f} ({real - twins.max():.1f} to {real - twins.min():.1f})"
            )
        print(f"| {'out' if out else 'in'} | {label} | " + " | ".join(cells) + " |")
