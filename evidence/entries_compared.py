"""One entry of the proving ground beside others, mine by mine: by site and kind, false alarms at a Pd, calibration.

``python evidence/entries_compared.py fused3 fused --folder GROUND [--folder OTHER] [--tier T]`` opens the sealed truth
of the first folder, which is logged, and prints Markdown tables of the first entry against the second and against the
best of all other entries of the folders, in the standard split and at sites not seen in training (mines in the other
splits, too):

- mines found at 0.02 false alarms per m² with exact 95 % intervals and chance, mines that one of the two alone finds,
  and p of McNemar's exact test. At a site the false alarms are those of its own lanes. The best entry is chosen after
  the fact, by its mines there, so that a p against it is larger than it would be against an entry chosen before;
- false alarms per m² at Pd 0.5, 0.7 and 0.9 of metal, and their ratio with its 95 % interval (bootstrap over mines);
  no false alarm counts as one;
- the expected calibration error of both (ten bins of the stated probability, alarms in lanes with targets) with its
  95 % interval (bootstrap over stretches of 10 m), and that of probabilities that are right, of as many alarms: median
  and 95 %.
"""

from __future__ import annotations

import argparse
import itertools
import math
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd

sys.path.append(str(Path(__file__).parent))
from common import Stated, far_at, markdown, matched, stated_in, with_share
from flgpr.scoring import (
    assign,
    chance,
    mcnemar_test,
    operating_row,
    roc_of,
)
from flgpr.scoring.lane_roc import far_area
from flgpr.scoring.matching import Match
from flgpr.trials import open_truth
from flgpr_ground.ground import Ground
from flgpr_ground.running import ALARMS, SEALED, entry_folder, passphrase, read_ground
from flgpr_ground.table import in_lanes

FAR = 0.02  # per m²
LEVELS = (0.5, 0.7, 0.9)  # of Pd
SPLITS = ("standard", "new-site")  # with every site by itself
OTHER_SPLITS = ("new-kind", "new-height", "variant")
BINS = 10
DRAWS = 2000


class Found(NamedTuple):
    """With how many false alarms an entry finds each target of some lanes."""

    target: pd.DataFrame  # truth
    far: np.ndarray  # (target,) per m², infinite for one never found
    least: float  # one false alarm over the area, per m²


def found_in(of_entry: Match, lanes: list[str]) -> Found:
    """Return what an entry finds in some of its lanes, against the false alarms of these."""
    one = in_lanes(of_entry, lanes)
    return Found(one.truth, assign(one)["far"].to_numpy(), 1 / far_area(one, "union"))


def chance_at(one: Match, scored: Sequence[str] = ()) -> float:
    """Return the Pd of mines that alarms which know nothing of them reach at 0.02 per m²."""
    mines = kinds_of(Found(one.truth, np.empty(0), 0.0), "mines", scored)
    curve = chance(one).add_chance_column(roc_of(one, mines), mines)
    return float(curve["chance"].iloc[int(operating_row(curve, np.array([FAR]))[0])])


def kinds_of(found: Found, group: str, scored: Sequence[str] = ()) -> np.ndarray:
    """Return which targets are mines, or of a kind; with some ``scored`` kinds mines of those alone."""
    kind = found.target["kind"].astype(str)
    if group != "mines":
        return (kind == group).to_numpy()
    return (kind.isin(scored) if scored else kind != "simulant").to_numpy()


def paired_cells(first: Found, second: Found, group: str, scored: Sequence[str] = ()) -> list[str]:
    """Return the cells of a row: what both find, what one alone finds, and p."""
    chosen = kinds_of(first, group, scored)
    mine = first.far[chosen] <= FAR
    other = second.far[chosen] <= FAR
    cells = [with_share(int(hits.sum()), hits.size) for hits in (mine, other)]
    alone = int((mine & ~other).sum())
    other_alone = int((other & ~mine).sum())
    return [*cells, f"+{alone} -{other_alone}", f"{mcnemar_test(alone, other_alone):.2g}"]


def ratio_cell(first: Found, second: Found, group: str, level: float) -> str:
    """Return false alarms at a Pd of both, and their ratio with its interval over resampled targets.

    No false alarm counts as one, so that there is a ratio wherever both reach the Pd.
    """
    chosen = kinds_of(first, group)
    far = np.maximum(first.far[chosen], first.least)
    other = np.maximum(second.far[chosen], second.least)
    own = far_at(far, level)
    its = far_at(other, level)
    cell = f"{_rate(own)}, {_rate(its)}"
    if math.isinf(own) or math.isinf(its):
        return cell
    rng = np.random.default_rng(51)
    ratios = []
    for _ in range(DRAWS):
        drawn = rng.integers(0, len(far), len(far))
        drawn_own = far_at(far[drawn], level)
        drawn_its = far_at(other[drawn], level)
        if math.isfinite(drawn_own) and math.isfinite(drawn_its):
            ratios.append(drawn_own / drawn_its)
    low, high = np.percentile(ratios, [2.5, 97.5])
    return f"{cell}: {own / its:.2f} ({low:.2f} to {high:.2f})"


def _rate(far: float) -> str:
    """Return false alarms per m² in words."""
    return f"{far:.4f}" if math.isfinite(far) else "never"


def calibration_error(p: np.ndarray, hit: np.ndarray) -> float:
    """Return the expected calibration error: mean over alarms of |stated - observed| of their bin."""
    number = np.minimum((p * BINS).astype(int), BINS - 1)
    count = np.bincount(number, minlength=BINS)
    difference = np.bincount(number, p, BINS) - np.bincount(number, hit, BINS)
    return float(np.abs(difference).sum() / count.sum())


def calibration_cells(stated: Stated) -> list[str]:
    """Return the cells of a row: alarms, hits, stated mean, error, and that of right probabilities."""
    rng = np.random.default_rng(51)
    stretches = np.unique(stated.stretch)
    rows = {number: np.flatnonzero(stated.stretch == number) for number in stretches}
    drawn_errors = []
    right_errors = []
    for _ in range(DRAWS):
        drawn = np.concatenate([rows[number] for number in rng.choice(stretches, len(stretches))])
        drawn_errors.append(calibration_error(stated.p[drawn], stated.hit[drawn]))
        right_errors.append(calibration_error(stated.p, rng.random(len(stated.p)) < stated.p))
    low, high = np.percentile(drawn_errors, [2.5, 97.5])
    middle, most = np.percentile(right_errors, [50, 95])
    error = calibration_error(stated.p, stated.hit)
    return [
        str(len(stated.p)),
        f"{stated.p.mean():.3f}, {stated.hit.mean():.3f}",
        f"{error:.3f} ({low:.3f} to {high:.3f})",
        f"{middle:.3f}, {most:.3f}",
    ]


# Tables


class Compared:
    """The entries of a tier in some folders."""

    def __init__(self, ground: Ground, folders: list[Path], truth: pd.DataFrame) -> None:
        self.ground = ground
        self.folders = folders
        self.truth = truth
        self._matches: dict[tuple[str, str], Match] = {}

    def entries(self, split: str) -> list[str]:
        """Return the names of all entries that have alarms of a split."""
        names = set()
        for folder in self.folders:
            for path in (folder / "entries").iterdir():
                if (entry_folder(folder, path.name, self.ground) / split / ALARMS).is_file():
                    names.add(path.name)
        return sorted(names)

    def match(self, entry: str, split: str) -> Match:
        """Return an entry's alarms of a split, matched."""
        key = (entry, split)
        if key not in self._matches:
            self._matches[key] = matched(self.ground, self.truth, self.folders, entry, split)
        return self._matches[key]

    def lanes(self, split: str, site: str, empty: bool = True) -> list[str]:
        """Return the names of the lanes of a split at a site, or at all sites."""
        names = []
        for lane in self.ground.tested(split):
            if site in (lane.site, "all") and (empty or not lane.empty):
                names.append(lane.name)
        return names

    def found(self, entry: str, split: str, site: str) -> Found:
        """Return what an entry finds at a site, or at all."""
        return found_in(self.match(entry, split), self.lanes(split, site))

    def scored(self, split: str) -> tuple[str, ...]:
        """Return the kinds of mines that a split is scored on; none for all."""
        return tuple(self.ground.table.splits[split].kinds or ())

    def best(self, split: str, site: str, without: str) -> list[str]:
        """Return the entries that find most mines at a site, one entry aside."""
        counts = {}
        for entry in self.entries(split):
            if entry != without:
                found = self.found(entry, split, site)
                mines = kinds_of(found, "mines", self.scored(split))
                counts[entry] = int((found.far[mines] <= FAR).sum())
        most = max(counts.values())
        return [entry for entry, count in counts.items() if count == most]


def pair_rows(
    compared: Compared, first: str, second: str, split: str, site: str
) -> Iterator[list[str]]:
    """Yield the rows of a split and a site: mines beside the others, and kinds beside the second."""
    scored = compared.scored(split)
    mine = compared.found(first, split, site)
    of_site = in_lanes(compared.match(first, split), compared.lanes(split, site))
    by_chance = f"{chance_at(of_site, scored):.2f}"
    best = compared.best(split, site, first)
    for other in dict.fromkeys([second, *best]):
        theirs = compared.found(other, split, site)
        title = f"{other}, best" if other in best else other
        kinds = ["mines"]
        if other == second and split in SPLITS:
            kinds += ["metal", "plastic", "ap"]
        for kind in kinds:
            own, its, alone, p = paired_cells(mine, theirs, kind, scored)
            chance_cell = by_chance if kind == "mines" else ""
            yield [split, site, kind, own, title, its, alone, p, chance_cell]


def report(compared: Compared, first: str, second: str) -> None:
    """Print the tables of a tier."""
    tier = compared.ground.tier or compared.ground.title
    places = list(itertools.product(SPLITS, [*compared.ground.sites, "all"]))
    pairs: list[list[str]] = []
    for split, site in [*places, *((split, "all") for split in OTHER_SPLITS)]:
        pairs += pair_rows(compared, first, second, split, site)
    ratios = []
    calibrations = []
    for split, site in places:
        mine = compared.found(first, split, site)
        theirs = compared.found(second, split, site)
        cells = [ratio_cell(mine, theirs, "metal", level) for level in LEVELS]
        ratios.append([split, site, *cells])
        lanes = compared.lanes(split, site, empty=False)
        for entry in (first, second):
            cells = calibration_cells(stated_in(compared.match(entry, split), lanes))
            calibrations.append([split, site, entry, *cells])
    print(f"\n{tier}: mines found at {FAR:g} false alarms per m²\n")
    head = ("split", "site", "kind", first, "other", "", "alone", "p (McNemar)", "chance")
    print(markdown(head, pairs))
    print(f"\n{tier}: false alarms per m² of {first} and of {second}, and their ratio\n")
    print(markdown(["split", "site", *(f"Pd {level:g} of metal" for level in LEVELS)], ratios))
    print(f"\n{tier}: calibration\n")
    of_right = "of right probabilities: median, 95 %"
    head = ("split", "site", "entry", "alarms", "stated, observed mean", "error", of_right)
    print(markdown(head, calibrations))


def main(arguments: list[str] | None = None) -> None:
    """Print the tables of all chosen tiers."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("first")
    parser.add_argument("second")
    parser.add_argument("--folder", action="append", type=Path, required=True)
    parser.add_argument("--tier")
    given = parser.parse_args(arguments)
    home = given.folder[0]
    tiers = read_ground(home).chosen_tiers(given.tier)
    truth, _, _ = open_truth(home / "lanes" / SEALED, passphrase(tiers[0]))
    for ground in tiers:
        report(Compared(ground, given.folder, truth), given.first, given.second)


if __name__ == "__main__":
    main()
