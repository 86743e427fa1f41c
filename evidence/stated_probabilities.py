"""How far the confidences of an entry of the proving ground are log odds: its expected calibration error by site.

``python evidence/stated_probabilities.py fused --folder ground/ [--folder other/] --tier prepared`` opens the sealed
truth of the first folder, which is logged, and prints the errors that docs/evidence/fused.md states.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np

sys.path.append(str(Path(__file__).parent))
from common import Stated, markdown, matched, stated_in
from flgpr.trials import open_truth
from flgpr_ground.lanes import SEALED, passphrase, read_ground

BINS = 10
SPLITS = ("standard", "new-site")


def calibration_error(stated: Stated) -> float:
    """Return the mean over alarms of |stated - observed| of their bin of the stated probability."""
    number = np.minimum((stated.p * BINS).astype(int), BINS - 1)
    difference = np.bincount(number, stated.p - stated.hit, BINS)
    return float(np.abs(difference).sum() / len(stated.p))


def main() -> None:
    """Print the table of an entry in a tier."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("entry")
    parser.add_argument("--folder", action="append", type=Path, required=True)
    parser.add_argument("--tier")
    given = parser.parse_args()
    home = given.folder[0]
    for ground in read_ground(home).chosen_tiers(given.tier):
        truth, _, _ = open_truth(home / "lanes" / SEALED, passphrase(ground))
        rows = []
        for split in SPLITS:
            one = matched(ground, truth, given.folder, given.entry, split)
            for site in (*ground.sites, "all"):
                lanes = [
                    lane.name
                    for lane in ground.tested(split)
                    if site in (lane.site, "all") and not lane.empty
                ]
                stated = stated_in(one, lanes)
                error = f"{calibration_error(stated):.3f}"
                rows.append([split, site, error, len(stated.p), int(stated.hit.sum())])
        print(f"\n{ground.tier or ground.title}\n")
        head = ["split", "site", "expected calibration error", "alarms", "hits"]
        print(markdown(head, rows))


if __name__ == "__main__":
    main()
