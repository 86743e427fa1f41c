"""Signal to clutter of buried bodies as sri-array sees them 12 m ahead, by formula and measured on simulated images.

``python evidence/signal_to_clutter.py`` measures every packaged body at five depths on every packaged site with four
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

from flgpr.design import (
    Viewing,
    expected_signal_to_clutter,
    ground_model,
    measure_signal_to_clutter,
)
from flgpr.imaging import ScanImager
from flgpr.model import Grid, load_sensor
from flgpr.simulate import Scene, Simulator, sites
from flgpr.simulate.bodies.signature import load_body, packaged_bodies
from flgpr.store.tables import read_columns

DOCS = Path(__file__).parents[1] / "docs"
TABLE = DOCS / "evidence" / "signal-to-clutter.csv"
IMAGES = DOCS / "images"
BANDS = {
    "F1": (0.75e9, 1.35e9),
    "F2": (1.25e9, 1.85e9),
    "F3": (1.75e9, 2.35e9),
    "F4": (2.25e9, 2.85e9),
}
CHANNELS = (("F1", "HH"), ("F1", "VV"), ("F4", "HH"))
ROUGHNESSES = (0.001, 0.002, 0.004, 0.008)
SEEDS = 6
FIGURES = ("formula_db", "measured_db", "margin_db")
SHOWN_SITES = ("prepared-earth", "arid-sand", "temperate")
# cm, mm
SHOWN_DEPTH = 7.5
SHOWN_ROUGHNESS = 2.0
ANTI_PERSONNEL = ("pma-1", "pmn")
COLOURS, LINES = (
    ("#c1440e", "#1b5e9b", "#3a7d44"),
    ("-", "--", "-.", ":", (0, (5, 1, 1, 1, 1, 1)), (0, (8, 3)), (0, (1, 3))),
)
KEY = ["site", "body", "depth_cm", "rms_mm"]


def site_table(site: str, bodies: list[str]) -> pd.DataFrame:
    """Table of a site, a row for every body, depth and roughness."""
    sensor = load_sensor("sri-array")
    viewing = Viewing(subbands={name: BANDS[name] for name in ("F1", "F4")})
    parts = []
    for rms_height in ROUGHNESSES:
        ground = ground_model(site, rms_height=rms_height)
        cases = expected_signal_to_clutter(sensor, ground, bodies, viewing=viewing)
        cases = cases.rename(columns={"signal_to_clutter_db": "formula_db"})
        found = measure_signal_to_clutter(sensor, ground, bodies, viewing=viewing, seeds=SEEDS)
        cases["measured_db"] = found["signal_to_clutter_db"]
        cases["margin_db"] = found["high_db"] - found["signal_to_clutter_db"]
        parts.append(one_row_per_case(site, cases))
    return pd.concat(parts)


def one_row_per_case(site: str, cases: pd.DataFrame) -> pd.DataFrame:
    """Bring the channels of a case side by side: by formula, measured, and half of its interval, dB."""
    rows: dict[tuple[str, float], dict[str, object]] = {}
    for case in cases.to_dict("records"):
        channel = case["subband"], case["polarization"]
        if channel not in CHANNELS:
            continue
        key = case["body"], case["depth"]
        row = rows.setdefault(
            key, {"site": site, "body": key[0], "depth_cm": round(100 * key[1], 1)}
        )
        row["rms_mm"] = round(1000 * case["rms_height"], 1)
        for figure in FIGURES:
            row[f"{'_'.join(channel).lower()}_{figure}"] = round(case[figure], 1)
    return pd.DataFrame(list(rows.values()))


def write_table(bodies: list[str]) -> pd.DataFrame:
    """Add what the table has not yet, site by site, and write it after each."""
    table = read_columns(TABLE) if TABLE.is_file() else pd.DataFrame(columns=KEY)
    for site in sites():
        there = table[table["site"] == site]
        missing = [body for body in bodies if body not in set(there["body"])]
        if missing:
            new = site_table(site, missing)
            others = table[(table["site"] != site) | ~table["body"].isin(missing)]
            table = pd.concat([others, new]) if len(others) else new
            table = table.sort_values(KEY, kind="stable").reset_index(drop=True)
            TABLE.parent.mkdir(parents=True, exist_ok=True)
            table.to_csv(TABLE, index=False)
            print(f"{site}: {', '.join(missing)}", flush=True)
    return table


def group_of(body: str) -> int:
    """Tell anti-tank mines with metal (0) and without (1) and anti-personnel mines (2) apart."""
    if body in ANTI_PERSONNEL:
        return 2
    return 0 if load_body(body).metal else 1


def draw_roughness(table: pd.DataFrame) -> Figure:
    """Draw signal to clutter over roughness, sites as rows, channels as columns: lines by formula, dots measured."""
    figure = Figure(figsize=(13, 9.5), layout="constrained")
    panels = figure.subplots(len(SHOWN_SITES), len(CHANNELS), sharex=True, sharey=True)
    bodies = sorted(table["body"].unique(), key=lambda body: (group_of(body), body))
    for row, site in zip(panels, SHOWN_SITES, strict=True):
        for axes, (subband, polarization) in zip(row, CHANNELS, strict=True):
            channel = f"{subband}_{polarization}".lower()
            for body in bodies:
                part = table[
                    (table["site"] == site)
                    & (table["body"] == body)
                    & (table["depth_cm"] == SHOWN_DEPTH)
                ]
                style = LINES[
                    [one for one in bodies if group_of(one) == group_of(body)].index(body)
                    % len(LINES)
                ]
                colour = COLOURS[group_of(body)]
                axes.plot(
                    part["rms_mm"],
                    part[f"{channel}_formula_db"],
                    ls=style,
                    color=colour,
                    lw=1.4,
                    label=body,
                )
                axes.plot(part["rms_mm"], part[f"{channel}_measured_db"], ".", color=colour, ms=7)
            axes.axhline(0, color="0.5", lw=0.8)
            axes.set_title(f"{site}, {subband} {polarization}", fontsize=11)
            axes.set_xscale("log", base=2)
            axes.set_xticks([1, 2, 4, 8], ["1", "2", "4", "8"])
            axes.grid(alpha=0.25)
    for axes in panels[-1]:
        axes.set_xlabel("rms height of the surface (mm)")
    for axes in panels[:, 0]:
        axes.set_ylabel("signal to clutter (dB)")
    handles, labels = panels[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside right center", fontsize=9, handlelength=3)
    return figure


def draw_sites(table: pd.DataFrame) -> Figure:
    """Draw the signal to clutter of every body on every site as a heat map, a channel each."""
    part = table[(table["depth_cm"] == SHOWN_DEPTH) & (table["rms_mm"] == SHOWN_ROUGHNESS)]
    bodies = sorted(part["body"].unique(), key=lambda body: (group_of(body), body))
    figure = Figure(figsize=(15, 0.42 * len(bodies) + 2.2), layout="constrained")
    panels = figure.subplots(1, len(CHANNELS), sharey=True)
    for axes, (subband, polarization) in zip(panels, CHANNELS, strict=True):
        levels = part.pivot_table(
            f"{subband}_{polarization}_formula_db".lower(), "body", "site"
        ).loc[bodies]
        image = axes.imshow(levels, cmap="RdBu", vmin=-25, vmax=25, aspect="auto")
        for (i, j), level in np.ndenumerate(levels.to_numpy()):
            colour = "white" if abs(level) > 16 else "black"
            axes.text(j, i, f"{level:.0f}", ha="center", va="center", fontsize=9, color=colour)
        axes.set_xticks(range(levels.shape[1]), levels.columns, rotation=40, ha="right")
        axes.set_yticks(range(len(bodies)), bodies)
        axes.set_title(f"{subband} {polarization}")
    figure.colorbar(image, ax=list(panels), label="signal to clutter (dB)")
    return figure


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
        clutter = np.mean(
            [power(quiet(site), seed).mean(axis=(2, 3)) for seed in range(SEEDS)], axis=0
        )
        for kind, (i, depth) in itertools.product(
            ("metal", "plastic"), enumerate(INDEPENDENT_DEPTHS)
        ):
            target = [{"kind": kind, "x": 0.0, "y": 12.0, "depth": depth}]
            alone = quiet(site, targets=target, surface={"echo": False, "phase_screen": False})
            hh, vv = 10 * np.log10(
                power(alone, 0)[:2].max(axis=(2, 3)) / clutter[:2]
            )  # a level mine has no HV
            figures = " | ".join(f"{value:.1f}" for value in (vv[0], hh[1], hh[2], hh[3], vv[3]))
            print(
                f"| {site} | {kind} | {100 * depth:.0f} | {hh[0]:.1f} | {INDEPENDENT[site, kind][i]} | {figures} |"
            )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--independent",
        action="store_true",
        help="print the table of independent estimates instead",
    )
    if parser.parse_args().independent:
        print_independent()
        return
    table = write_table(packaged_bodies())
    draw_roughness(table).savefig(IMAGES / "signal-to-clutter-roughness.png", dpi=90)
    draw_sites(table).savefig(IMAGES / "signal-to-clutter-sites.png", dpi=90)
    for subband, polarization in CHANNELS:
        channel = f"{subband}_{polarization}".lower()
        off = (table[f"{channel}_measured_db"] - table[f"{channel}_formula_db"]).dropna()
        spread = f"{off.mean():+.2f} dB, {off.min():+.1f} to {off.max():+.1f}"
        print(f"{subband} {polarization}: measured less formula {spread}")


if __name__ == "__main__":
    main()
