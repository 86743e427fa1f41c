"""What the ground's echo and the direct wave change for a high array: mines that C_HH finds with sri-array.

``python evidence/ground_echo_high.py OUT`` simulates training lanes of proving-ground-2, one a site and tier, with the
packaged sensor and with ``specular_echo`` and ``direct_wave`` on, everything else alike, and counts the mines that the
contrast of Wang et al. 2007 (C_HH, recipe ``wang2007`` without its ten features) finds. Alarms are written into OUT as
soon as a lane is done, and lanes that are there are not simulated again. A minute of a core a lane.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np
import pandas as pd

sys.path.append(str(Path(__file__).parent))
sys.path.append(str(Path(__file__).parents[1] / "tests"))
from common import markdown, with_share
from flgpr.method.imaged_run import ImagedRun
from flgpr.method.method import detection_of, engine_of
from flgpr.proving_ground import load_ground
from flgpr.recipe.schema import load_recipe
from flgpr.scoring import match, operating_row, roc_of
from flgpr.simulate import Simulator
from flgpr_ground.ground import Ground, GroundLane

WORLDS = {
    "as packaged": {},
    "with specular echo": {"specular_echo": True},
    "with direct wave": {"direct_wave": True},
    "with echo and direct wave": {"specular_echo": True, "direct_wave": True},
}
HALO = 1.0  # m, as on the proving ground
FARS = (0.005, 0.02, 0.05)  # per m²


def chosen_lanes(ground: Ground) -> list[GroundLane]:
    """Return the first training lane of each site and tier."""
    first: dict[tuple[str, str], GroundLane] = {}
    for lane in ground.lanes.values():
        if lane.part == "train":
            first.setdefault((lane.tier, lane.site), lane)
    return list(first.values())


def detect(lane: GroundLane, changes: dict[str, bool]) -> pd.DataFrame:
    """Return the alarms of C_HH on a lane, seen by its sensor with changes."""
    recipe = load_recipe("wang2007").model_copy(update={"features": None})
    sensor = lane.sensor.model_copy(update=changes)
    run = Simulator(lane.scene, sensor, lane.seed).run()
    setup = ImagedRun(run, recipe, lane.lane, explains=False)
    engine_of(setup).run()
    return detection_of(setup).alarms[["x", "y", "confidence"]]


def report(lanes: list[GroundLane], out: Path) -> None:
    """Print how many mines are found in every tier and world, on the lanes that are done."""
    rows = []
    for tier in sorted({lane.tier for lane in lanes}):
        for world in WORLDS:
            some = [
                lane for lane in lanes if lane.tier == tier and file_of(out, lane, world).exists()
            ]
            if not some:
                continue
            files = {lane.name: file_of(out, lane, world) for lane in some}
            alarms = [pd.read_csv(path).assign(lane=name) for name, path in files.items()]
            truth = [lane.truth().assign(lane=lane.name) for lane in some]
            matched = match(
                pd.concat(alarms, ignore_index=True),
                pd.concat(truth, ignore_index=True),
                {lane.name: lane.lane for lane in some},
                HALO,
            )
            curve = roc_of(matched)
            cells = []
            for row in operating_row(curve, np.array(FARS)):
                found = int(curve.iloc[row]["n_detected"])
                cells.append(with_share(found, sum(map(len, truth))))
            rows.append([tier, str(len(some)), world, *cells])
    head = ["tier", "lanes", "world", *(f"mines at {far:g} per m²" for far in FARS)]
    print(markdown(head, rows))


def file_of(out: Path, lane: GroundLane, world: str) -> Path:
    """Return where the alarms of a lane in a world are written."""
    return out / f"{lane.name}, {world}.csv"


def main() -> None:
    """Simulate and detect what is missing, and print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("out", type=Path)
    parser.add_argument("--lanes", type=int, default=8, help="so many lanes, the first ones")
    parser.add_argument("--report", action="store_true", help="simulate nothing, print the table")
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    lanes = chosen_lanes(load_ground(False, "proving-ground-2"))[: given.lanes]
    for lane in [] if given.report else lanes:
        for world, changes in WORLDS.items():
            path = file_of(given.out, lane, world)
            if not path.exists():
                detect(lane, changes).to_csv(path, index=False)
                print(path.stem, flush=True)
    report(lanes, given.out)


if __name__ == "__main__":
    main()
