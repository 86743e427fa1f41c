"""Why `fused` misses the mines of the packaged full-wave lane: four experiments, each of which could refute its cause.

``python evidence/why_full_wave.py OUT [--twins 40] [--figure docs/images/fused-full-wave.png]`` writes CSV files into
OUT, prints Markdown tables and draws the figure; ten minutes of one core. The lane has three mines, which by
themselves decide nothing (0 of 3 against 2 of 3: p = 0.5). So twins of the lane, simulated over other surfaces, tell
what to expect of either detector, and the full-wave lane is held against their spread.

The recipe of `fused` for this array is put together here by hand: the packaged one with the images, windows and radii
of the recipe `miniature`.

1. *Clutter.* The twin has the lane's array, soil, targets, rock and post; its surface is drawn anew. If the rough
   surface, or the low array, is the cause, `fused` misses the mines of the twins as well.
2. *Covariance.* `fused` takes its covariance from lanes of the proving ground, from twins without targets, or from the
   full-wave lane itself, where no chip is tried with a covariance that it is in (three folds). If a wrong covariance is
   the cause, the lane's own one finds the mines.
3. *Signatures.* The echo of a body alone, full wave with the body less full wave without it (tests/data/signatures), is
   held against the simulator's and against the directions in which `fused` looks. In the lane, chips at the mines are
   held against the simulated echo of each mine, in the twins as in the full-wave lane. No full-wave lane was computed
   with and without its targets. If the signatures are the cause, full wave correlates less than the twins do.
4. *The array's own echoes*, which the twins lack: the direct wave, and the ground under the array. The stage `early`
   takes them out by their path, in the whole band. If they are the cause, the full-wave lane without them is like the
   twins, and the twins with them are like the full-wave lane.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from pathlib import Path

import pandas as pd

from flgpr.store.tables import read_columns

sys.path.append(str(Path(__file__).parent))
sys.path.append(str(Path(__file__).parents[1] / "tests"))
from full_wave_causes.detection import experiment_covariance, experiment_lanes
from full_wave_causes.figure import draw
from full_wave_causes.lanes import known_lanes
from full_wave_causes.signatures import by_difference, in_the_lane
from full_wave_causes.tables import report_found, report_signatures


def main(arguments: list[str] | None = None) -> None:
    """Run the experiments, write the tables and draw the figure."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("--twins", type=int, default=40)
    parser.add_argument(
        "--known", type=int, default=24, help="training lanes of the proving ground"
    )
    parser.add_argument(
        "--summary", action="store_true", help="tables and figure of what is in OUT"
    )
    parser.add_argument("--figure", type=Path)
    given = parser.parse_args(arguments)
    given.out.mkdir(parents=True, exist_ok=True)
    if not given.summary:
        for name, rows in measure(given.twins, given.known):
            table = pd.DataFrame(rows)
            table.to_csv(given.out / f"{name}.csv", index=False, float_format="%.6g")
    tables = {}
    for name in ("found", "by-difference", "in-the-lane", "ground"):
        tables[name] = read_columns(given.out / f"{name}.csv")
    report_found(tables["found"])
    report_signatures(tables["by-difference"], tables["in-the-lane"], tables["ground"])
    if given.figure is not None:
        draw(tables["found"], tables["in-the-lane"], tables["ground"], given.figure)


def measure(twins: int, known_count: int) -> Iterator[tuple[str, list[dict]]]:
    """Run the experiments and yield the rows of each table as soon as they are complete."""
    yield "by-difference", by_difference()
    lane, ground, (scale, spread) = in_the_lane(max(twins // 2, 2))
    print(f"scale {scale:.4g} of the data by the direct wave, {spread:.3f} dB rms over pairs")
    yield "in-the-lane", lane
    yield "ground", ground
    known = known_lanes(known_count)
    found: list[dict] = []
    experiment_lanes(twins, known, found)
    experiment_covariance(twins, known, found)
    yield "found", found


if __name__ == "__main__":
    main()
