"""Signal to clutter of buried bodies as sri-array sees them 12 m ahead, by formula and measured on simulated images.

``python benchmarks/signal_to_clutter.py`` measures every packaged body at five depths on every packaged site with four
roughnesses of its surface, and writes a table and a figure of it to the documentation. Bodies and sites that stand in
the table are not measured again. ``--independent`` prints a smaller table beside figures found by others' formulas.
"""

from __future__ import annotations

import argparse
import itertools
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from flgpr.design import expected_signal_to_clutter, ground_model, measure_signal_to_clutter
from flgpr.imaging import ScanImager
from flgpr.model import Grid, load_sensor
from flgpr.simulate import Scene, Simulator, sites
from flgpr.simulate.signature import packaged_bodies

DOCS = Path(__file__).parents[1] / "docs"
TABLE = DOCS / "evidence" / "signal-to-clutter.csv"
FIGURE = DOCS / "images" / "signal-to-clutter.png"
BANDS = {"F1": (0.75e9, 1.35e9), "F2": (1.25e9, 1.85e9), "F3": (1.75e9, 2.35e9), "F4": (2.25e9, 2.85e9)}
CHANNELS = (("F1", "HH"), ("F1", "VV"), ("F4", "HH"))
ROUGHNESSES = (0.001, 0.002, 0.004, 0.008)
SEEDS = 6
KEY = ["site", "body", "depth_cm", "rms_mm"]


def measure_site(site: str, bodies: list[str]) -> pd.DataFrame:
    """Table of a site, a row for every body, depth and roughness."""
    sensor = load_sensor("sri-array")
    bands = {name: BANDS[name] for name in ("F1", "F4")}
    parts = []
    for rms_height in ROUGHNESSES:
        ground = ground_model(site, rms_height=rms_height)
        expected = expected_signal_to_clutter(sensor, ground, bodies, subbands=bands)
        measured = measure_signal_to_clutter(sensor, ground, bodies, subbands=bands, seeds=SEEDS)
        parts.append(one_row_per_case(site, expected, measured))
    return pd.concat(parts)


def one_row_per_case(site: str, expected: pd.DataFrame, measured: pd.DataFrame) -> pd.DataFrame:
    """Bring the channels of a case side by side: by formula, measured, and half of its interval, dB."""
    rows: dict[tuple[str, float], dict[str, object]] = {}
    for formula, found in zip(expected.to_dict("records"), measured.to_dict("records"), strict=True):
        channel = formula["subband"], formula["polarization"]
        if channel not in CHANNELS:
            continue
        case = formula["body"], formula["depth"]
        row = rows.setdefault(case, {"site": site, "body": case[0], "depth_cm": round(100 * case[1], 1)})
        row["rms_mm"] = round(1000 * formula["rms_height"], 1)
        name = "_".join(channel).lower()
        row[f"{name}_formula_db"] = round(formula["signal_to_clutter_db"], 1)
        row[f"{name}_measured_db"] = round(found["signal_to_clutter_db"], 1)
        row[f"{name}_margin_db"] = round(found["high_db"] - found["signal_to_clutter_db"], 1)
    return pd.DataFrame(list(rows.values()))


def write_table(bodies: list[str]) -> pd.DataFrame:
    """Measure what the table has not yet, site by site, and write it after each."""
    table = pd.read_csv(TABLE) if TABLE.is_file() else pd.DataFrame(columns=KEY)
    for site in sites():
        there = set(table.loc[table["site"] == site, "body"])
        missing = [body for body in bodies if body not in there]
        if missing:
            new = measure_site(site, missing)
            table = new if table.empty else pd.concat([table, new])
            table = table.sort_values(KEY, kind="stable").reset_index(drop=True)
            TABLE.parent.mkdir(parents=True, exist_ok=True)
            table.to_csv(TABLE, index=False)
            print(f"{site}: {len(missing)} bodies measured", flush=True)
    return table


def power(scene: Scene, seed: int) -> np.ndarray:
    """|image|² (polarization, sub-band, y, x) of one scan without the radar's errors."""
    grid = Grid.spanning((-0.6, 0.6), (11.4, 12.8), 0.05)
    run = Simulator(scene, load_sensor("sri-array"), seed, errors=False).run()
    return np.abs(next(iter(ScanImager(run, grid, BANDS, tolerance=1e-3))).values) ** 2


def quiet(site: str, **parts) -> Scene:
    """Give a site's soil and surface and nothing else, but for ``parts``."""
    off = ("terrain", "grass", "shadow", "stones", "roots", "lenses", "heterogeneity", "holes")
    nothing = {"rocks": 0.0, "bushes": 0.0, "posts": 0.0, "patches": 0.0}
    alone = {part: {"on": False} for part in off}
    scene = {"site": site, "length": 30.0, "track": {"positions": (0.0,)}, "clutter": nothing}
    return Scene(**(scene | alone | parts))


INDEPENDENT_DEPTHS = (0.01, 0.05, 0.10, 0.15)
INDEPENDENT = {
    ("arid-sand", "metal"): (17, 15, 13, 11),
    ("arid-sand", "plastic"): (4, 2, 0, -2),
    ("temperate", "metal"): (14, 10, 6, 2),
    ("temperate", "plastic"): (7, 3, 0, -4),
}  # dB, F1 HH, by formulas that share nothing with the simulator


def print_independent() -> None:
    """Print the generic mines' signal to clutter beside independent estimates."""
    print("| soil | mine | depth (cm) | F1 HH | expected | F1 VV | F2 HH | F3 HH | F4 HH | F4 VV |")
    print("|---|---|---|---|---|---|---|---|---|---|")
    for site in ("arid-sand", "temperate"):
        clutter = np.mean([power(quiet(site), seed).mean(axis=(2, 3)) for seed in range(SEEDS)], axis=0)
        for kind, (i, depth) in itertools.product(("metal", "plastic"), enumerate(INDEPENDENT_DEPTHS)):
            target = [{"kind": kind, "x": 0.0, "y": 12.0, "depth": depth}]
            alone = quiet(site, targets=target, surface={"echo": False, "phase_screen": False})
            hh, vv = 10 * np.log10(power(alone, 0)[:2].max(axis=(2, 3)) / clutter[:2])  # a level mine has no HV
            figures = " | ".join(f"{value:.1f}" for value in (vv[0], hh[1], hh[2], hh[3], vv[3]))
            print(f"| {site} | {kind} | {100 * depth:.0f} | {hh[0]:.1f} | {INDEPENDENT[site, kind][i]} | {figures} |")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--independent", action="store_true", help="print the table of independent estimates instead")
    parser.add_argument("--figure", action="store_true", help="only draw the figure of the table that is there")
    parser.add_argument("--bodies", nargs="*", help="packaged bodies to measure; all by default")
    arguments = parser.parse_args()
    if arguments.independent:
        print_independent()
        return
    table = pd.read_csv(TABLE) if arguments.figure else write_table(arguments.bodies or packaged_bodies())


if __name__ == "__main__":
    main()
