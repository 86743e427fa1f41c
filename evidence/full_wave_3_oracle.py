"""Which mines lie near threshold for the lanes of full-wave-3: an oracle's deflection on simulated ground.

``python evidence/full_wave_3_oracle.py`` simulates, over each soil and roughness of ``full_wave_3.toml``, a long bare
lane and a long lane of mines 2.1 m apart, both seen from pairs of stops as those lanes are, and prints how many mines
of each body and cover an oracle finds that knows body, soil, cover and place (``flgpr_ground/oracle.py``). It chose the
mines of ``full_wave_3.toml``. No detector ran on these lanes.
"""

from __future__ import annotations

import itertools

import numpy as np
import pandas as pd

from flgpr.model import load_sensor
from flgpr.simulate import Scene, Simulator
from flgpr_ground.ground import GroundLane
from flgpr_ground.oracle import BareGround, cleaned_run, looks_at_mines

PIECES = 20  # pieces of lane, each as long as a lane of full-wave-3
LENGTH = 6.4  # m
STOPS = (-1.135, 0.905)  # m from the begin of a piece
SOILS = {"fair": (4.0, 0.003), "damp": (5.2, 0.006)}
ROUGHNESS = (0.0065, 0.008)  # m rms
SORTS = {
    "metal": ("metal", "metal-at", (0.06, 0.09, 0.12)),
    "gap": ("plastic", "plastic-at", (0.015, 0.03, 0.06)),
    "solid": ("plastic", "plastic-at-solid", (0.015, 0.03)),
    "fuzed": ("plastic", "tm-62p", (0.06, 0.09, 0.12)),
}
RATES = (0.05, 0.1, 0.2)  # false alarms per m²
RECIPE = "miniature"


def main() -> None:
    """Print the table of mines found by body and cover, and by place."""
    rows = []
    for (soil, medium), rms in itertools.product(SOILS.items(), ROUGHNESS):
        found = oracle_rows(medium, rms, seed=300 + len(rows))
        rows.append(found.assign(soil=soil, rms=rms))
        print(soil, rms, "done", flush=True)
    table = pd.concat(rows, ignore_index=True)
    for rate in RATES:
        table[f"found {rate:g}"] = table["far"] <= rate
    columns = [f"found {rate:g}" for rate in RATES]
    for keys in (["sort", "depth"], ["soil", "rms"], ["row"]):
        shown = table.groupby(keys)[columns].sum().assign(mines=table.groupby(keys).size())
        print(shown.to_string())


def oracle_rows(medium: tuple[float, float], rms: float, seed: int) -> pd.DataFrame:
    """Return at how many false alarms per m² each mine over a soil is found."""
    bare = ground_lane(medium, rms, seed, [])
    mines = mines_of(np.random.default_rng(seed))
    lane = ground_lane(medium, rms, seed + 1, mines)
    bare_setup, setup = (
        cleaned_run(Simulator(of.scene, of.sensor, of.seed).run(), of.lane, RECIPE)
        for of in (bare, lane)
    )
    clutter = BareGround(bare_setup, bare.lane)
    looks, echoes = looks_at_mines(setup, lane, pd.DataFrame(mines))
    rows = []
    for number, mine in enumerate(mines):
        of_mine = looks.place == number
        rates = clutter.rates(looks.ahead[of_mine], looks.chip[of_mine], echoes[of_mine])
        row = int(mine["y"] % LENGTH // 2)
        rows.append({"sort": mine["sort"], "depth": mine["depth"], "row": row, **rates})
    return pd.DataFrame(rows)


def mines_of(rng: np.random.Generator) -> list[dict]:
    """Return mines of all sorts and covers in turn, three a piece, in two columns."""
    sorts = [(sort, depth) for sort, (*_, depths) in SORTS.items() for depth in depths]
    mines = []
    for number in range(3 * PIECES):
        piece, place = divmod(number, 3)
        sort, depth = sorts[number % len(sorts)]
        kind, body, _ = SORTS[sort]
        mines.append(
            {
                "sort": sort,
                "kind": kind,
                "body": body,
                "x": float(rng.choice([-0.5, 0.0, 0.5])),
                "y": LENGTH * piece + 1.1 + 2.1 * place,
                "depth": depth,
            }
        )
    return mines


def ground_lane(
    medium: tuple[float, float], rms: float, seed: int, mines: list[dict]
) -> GroundLane:
    """Return a long lane over a soil, with mines or bare."""
    targets = [{name: mine[name] for name in ("kind", "body", "x", "y", "depth")} for mine in mines]
    stops = [LENGTH * piece + stop for piece in range(PIECES) for stop in STOPS]
    scene = Scene.model_validate(
        {
            "name": "mines" if mines else "bare",
            "x_min": -1.0,
            "x_max": 1.0,
            "length": LENGTH * PIECES,
            "soil": {"model": "fixed", "permittivity": medium[0], "conductivity": medium[1]},
            "surface": {"rms_height": rms, "correlation_length": 0.10},
            "track": {"positions": stops},
            "targets": targets,
        }
    )
    sensor = load_sensor("full-wave")
    return GroundLane(scene.name, "", "test", scene.lane, seed, scene, sensor)


if __name__ == "__main__":
    main()
