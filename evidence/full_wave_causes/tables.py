"""Tables and figure of the four experiments."""

from __future__ import annotations

import numpy as np
import pandas as pd

from common import markdown, with_share
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
    by_world = []
    by_target = []
    for detector, rows in table.groupby("detector", sort=False):
        cells = [detector]
        for world in worlds:
            some = rows[rows["world"] == world]
            cells.append(of_three(some.set_index("seed")["found"]) if len(some) else "")
        by_world.append(cells)
        by_target.append([detector, *_target_cells(rows)])
    print(
        "\nTargets found at one false alarm, of 3: mean over twins (95 % of them; twins with 0, 1, 2, 3)\n"
    )
    print(markdown(["detector", *worlds], by_world))
    print(
        "\nFalse alarms before each target of the full-wave lane; in the twins the median and how often found at one\n"
    )
    head = ("detector", "full wave", "twins, mine 1", "mine 2", "mine 3", "mine 2 behind, m")
    print(markdown(head, by_target))


def _target_cells(rows: pd.DataFrame) -> list[str]:
    """Return the cells of a detector: false alarms, twins that find each target, where the second is."""
    of_lane = rows[rows["world"] == "full wave"].set_index("target")
    twins = rows[rows["world"] == OWN]
    before = of_lane["false_alarms"]
    cells = [", ".join("never" if np.isinf(count) else f"{count:.0f}" for count in before)]
    for target in before.index:
        found = twins.loc[twins["target"] == target, "found"]
        cells.append(with_share(int(found.sum()), len(found)) if len(found) else "")
    second = before.index[1]
    behind = twins.loc[twins["target"] == second, "behind"].dropna()
    spread = ""
    if len(behind):
        low, middle, high = np.percentile(behind, [2.5, 50, 97.5])
        spread = f"; twins {middle:.2f} ({low:.2f} to {high:.2f})"
    return [*cells, f"{of_lane['behind'][second]:.2f}{spread}"]


def report_signatures(alone: pd.DataFrame, lane: pd.DataFrame, clutter: pd.DataFrame) -> None:
    """Print what experiment 3 measured."""
    rows = []
    for column in ("coherence", "level_db", "share_full_wave", "share_simulated"):
        ends = np.percentile(alone[column], [0, 50, 100])
        rows.append([column, *(f"{value:.3f}" for value in ends)])
    for name in ("coherence", "level_db"):
        some = alone.filter(regex=f"^{name}_")
        title = f"{name}, single polarization and sub-band"
        rows.append([title, f"{some.min().min():.3f}", "", f"{some.max().max():.3f}"])
    print(f"\n{markdown(('echo of a body alone, 18 cases', 'least', 'median', 'most'), rows)}")
    print(
        "\nChips at the mines and their own simulated echoes, over scans (twins: median and central 95 %)\n"
    )
    rows = []
    for (out, target), some in lane.groupby(["early_out", "target"]):
        for name in ("coherence", "by_chance_95", "level_db", "level_db_HH", "level_db_VV"):
            scans = ", ".join(f"{v:.2f}" for v in some.loc[some["world"] == "full wave", name])
            low, middle, high = np.percentile(some.loc[some["world"] == OWN, name], [2.5, 50, 97.5])
            twins = f"{middle:.2f} ({low:.2f} to {high:.2f})"
            rows.append(["out" if out else "in", target, name, scans, twins])
    print(markdown(("early echoes", "target", "quantity", "full wave, scans", "twins"), rows))
    print("\nGround away from targets, full wave less twins (dB; range over twins)\n")
    rows = []
    for (out, label), some in clutter.groupby(["early_out", "polarization"]):
        cells = ["out" if out else "in", label]
        for band in BANDS:
            levels = some[some["band"] == band].set_index("world")["level_db"]
            real = levels["full wave"]
            twins = levels[OWN]
            cells.append(
                f"{real - twins.mean():.1f} ({real - twins.max():.1f} to {real - twins.min():.1f})"
            )
        rows.append(cells)
    print(markdown(["early echoes", "polarization", *BANDS], rows))
