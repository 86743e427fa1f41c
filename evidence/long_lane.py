"""Measure the memory of a detection on a long lane, in sections, and what sections cost.

The run is noise on the geometry of the ``sri-array`` with the recipe ``wang2007``, see
``benchmarks/suite/data.py``. Usage::

    NUMBA_NUM_THREADS=1 OMP_NUM_THREADS=1 python evidence/long_lane.py [--length 20000] [--scans
    18] NUMBA_NUM_THREADS=1 OMP_NUM_THREADS=1 python evidence/long_lane.py --compare 250 --scans
    600 --length 1000

The memory of a detection does not depend on the number of scans, so a few at the beginning of a long lane are enough
to measure it. With ``--compare`` the lane is taken in one piece and in sections of so many metres, and run-views and
alarms are compared bit by bit.
"""

from __future__ import annotations

import argparse
import math
import resource
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import pandas as pd

import flgpr
from flgpr.method.memory import lane_memory
from flgpr.method.sections import plan_sections
from flgpr.model import Lane
from flgpr.recipe.schema import load_recipe
from flgpr.results.result import read_result
from flgpr.results.sections import results_at
from flgpr.store import lane_text

sys.path.insert(0, str(Path(__file__).parents[1] / "benchmarks"))
from suite.data import written_elsewhere

SIZES = {"polarization": 3, "pair": 36, "frequency": 1024}


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--length", type=float, default=20_000.0)
    parser.add_argument("--scans", type=int, default=18)
    parser.add_argument("--compare", type=float)
    arguments = parser.parse_args()
    recipe = load_recipe("wang2007")
    lane = Lane(-1.5, 1.5, 0.0, arguments.length)
    with tempfile.TemporaryDirectory() as temporary:
        home = Path(temporary)
        written_elsewhere(home / "run.zarr", arguments.scans)
        area = home / "lane.toml"
        area.write_text(lane_text(lane))
        options = {"lane": area, "report": arguments.compare is None}
        begun = time.process_time()
        flgpr.detect(
            home / "run.zarr", "wang2007", home / "cut", section=arguments.compare, **options
        )
        folders = results_at(home / "cut")
        cost = time.process_time() - begun
        most = max(section.stop - section.start for section in plan_sections(SIZES, recipe, lane))
        peak = 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        print(
            f"{arguments.scans} scans, lane of {arguments.length:.0f} m in {len(folders)} sections: {cost:.1f} s"
        )
        estimate = lane_memory(SIZES, recipe, lane).needed(most) / 1e9
        print(
            f"peak {peak / 1e9:.2f} GB, estimated {estimate:.2f} GB; in one piece {_whole(recipe, lane):.2f} GB"
        )
        if arguments.compare is not None:
            begun = time.process_time()
            whole = flgpr.detect(
                home / "run.zarr", "wang2007", home / "whole", section=math.inf, **options
            )
            print(f"in one piece {time.process_time() - begun:.1f} s")
            _compare(folders, whole.detections[0])


def _whole(recipe, lane):
    return lane_memory(SIZES, recipe, lane).needed() / 1e9


def _compare(folders, whole):
    parts = [read_result(folder).detections[0] for folder in folders]
    same = np.array_equal(
        np.concatenate([part.view.values for part in parts], 2), whole.view.values, equal_nan=True
    )
    columns = ["x", "y", "magnitude", "confidence", "scans"]
    alarms = pd.concat([part.alarms[columns] for part in parts]).sort_values(
        columns[:2], ignore_index=True
    )
    alike = alarms.equals(whole.alarms[columns].sort_values(columns[:2], ignore_index=True))
    print(
        f"run-view {'the same' if same else 'DIFFERENT'}, {len(alarms)} alarms {'the same' if alike else 'DIFFERENT'}"
    )


if __name__ == "__main__":
    main()
