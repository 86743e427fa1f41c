"""Two entries target by target: who finds what, the ROC of both with their difference, and chips.

The page is made for a paper: beside it lie the figure, a table in LaTeX and entries of BibTeX.
"""

from __future__ import annotations

import io
import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from matplotlib.figure import Figure
from matplotlib.image import imsave

from flgpr.door import Folder
from flgpr.recipe.schema import parse_recipe
from flgpr.report import figure_png, render
from flgpr.report.curve_figures import compared_roc_figure, figure_bytes
from flgpr.report.kit import decibels
from flgpr.scoring import chance, match, operating_row, roc_of
from flgpr.scoring.comparison import found_from, paired_points
from flgpr.scoring.matching import Match
from flgpr.store import write_whole
from flgpr.store.tables import read_table_in
from flgpr.types import BoolArray, Entries, FloatArray
from flgpr_ground.citing import bibtex, latex_table
from flgpr_ground.entering import SHOWN
from flgpr_ground.entries import packaged_entries
from flgpr_ground.figures import kind_label
from flgpr_ground.ground import Ground, Score, opening_split
from flgpr_ground.lanes import SEALED, passphrase, read_ground
from flgpr_ground.running import ALARMS, entry_folder
from flgpr_ground.table import (
    chosen_mines,
    described,
    paired_sentence,
    score_entries,
    write_page,
)
from flgpr_trials.blind import open_truth

CHIP = 1.25  # m, half the side of a chip
_OUTCOMES = {
    (False, True): "missed by {0}, found by {1}",
    (True, False): "found by {0}, missed by {1}",
    (False, False): "missed by both",
    (True, True): "found by both",
}


@dataclass(frozen=True)
class Pair:
    """Two entries on one tier, in the opening split."""

    tier: Ground
    names: tuple[str, str]  #: the entry, and what it is compared with
    matches: tuple[Match, Match]
    mines: BoolArray  #: (target,) which of the targets are mines that are scored
    #: a row per mine: what the truth says of it but its place, and by entry, 1 and 2, the
    #: ``confidence`` of its best alarm (-inf for none) and ``far``, the false alarms per m² at which
    #: it is found (inf)
    targets: pd.DataFrame

    def found(self, number: int) -> BoolArray:
        """Return which mines an entry finds at the FAR of comparison."""
        return np.asarray(self.targets[f"far_{number}"] <= self.tier.table.far)

    def differences(self, fars: Sequence[float]) -> list[Entries]:
        """Return the difference of Pd, first less second, with its 95 % interval at FARs per m²."""
        return paired_points(*self.matches, fars, self.mines)

    def figure(self) -> Figure:
        """Draw the ROC curves of both, and below them their difference with its interval."""
        fars = self.tier.table.fars
        curves = {}
        points = []
        for name, matched in zip(self.names, self.matches, strict=True):
            curve = chance(matched).add_chance_column(roc_of(matched, self.mines), self.mines)
            rows = curve.iloc[operating_row(curve, np.array(fars))]
            points.append(rows.assign(detector=name, far_allowed=list(fars)))
            curves[name] = curve
        # Between the FARs at which either of the two finds one more nothing changes.
        steps = np.unique(self.targets[["far_1", "far_2"]].to_numpy())
        steps = np.concatenate([[0.0], steps[(steps > 0) & (steps < max(fars))], [max(fars)]])
        labels = {name: name for name in self.names}
        differences = pd.DataFrame(self.differences(list(steps)))
        return compared_roc_figure(curves, labels, pd.concat(points), max(fars), differences)


def compare_entries(
    folder: str | Path,
    entry: str,
    other: str | None = None,
    output: str | Path | None = None,
    tier: str | None = None,
) -> tuple[Path, list[str]]:
    """Compare an entry with another target by target, and write the page of both.

    The page shows chips of the images about the targets of test lanes. So the truth is opened, which
    is logged; cards that :func:`flgpr_ground.entering.write_submissions` makes in the same folder
    from then on say that test lanes were seen. No place of a target is told.

    Parameters
    ----------
    folder : str or path
        Folder of ``flgpr benchmark run``, which has the lanes and the alarms of both.
    entry : str
        Name of the entry.
    other : str, optional
        Name of what it is compared with; by default the reference of the ground.
    output : str or path, optional
        Takes ``index.html``, ``roc-TIER.pdf`` and ``.png``, ``targets.csv``, ``table.tex`` and
        ``cite.bib``; by default ``compared/ENTRY-OTHER`` in the folder.
    tier : str, optional
        The tier; by default, and with "all", all on which both ran.

    Returns
    -------
    page : Path
        The page.
    answers : list of str
        A sentence for each tier.

    Raises
    ------
    ValueError
        If the folder is no benchmark's, or there is no tier on which both ran.
    """
    home = Path(folder)
    ground = read_ground(home)
    names = (entry, other or ground.table.reference)
    if names[0] == names[1]:
        raise ValueError(f"other must be another entry than {entry}, got the same")
    titles, faults, _ = described(ground, [home])
    tiers = [of for of in ground.chosen_tiers(tier) if all(_has(home, name, of) for name in names)]
    if not tiers:
        known = ", ".join(sorted(path.name for path in (home / "entries").glob("*"))) or "none"
        reasons = [fault for fault in faults if fault.partition(" ")[0] in names]
        why = "; ".join([*reasons, f"in {home} are {known}"])
        raise ValueError(
            f"both entries must have run on a tier, split {opening_split(ground)}, got {names[0]} and "
            f"{names[1]}; {why}"
        )
    scores, _ = score_entries([home])
    truth, *_ = open_truth(home / "lanes" / SEALED, passphrase(ground))
    write_whole(home / "lanes" / SHOWN, json.dumps({"targets_of_test_lanes": "shown"}) + "\n")
    target = Path(output) if output else home / "compared" / "-".join(names)
    target.mkdir(parents=True, exist_ok=True)
    answers = []
    parts = []
    tables = []
    for of in tiers:
        pair = _pair(home, of, names, truth)
        answers.append(_answer(pair))
        figure = pair.figure()
        suffix = f"-{of.tier}" if of.tier else ""
        write_whole(target / f"roc{suffix}.pdf", figure_bytes(figure, "pdf"))
        write_whole(target / f"roc{suffix}.png", figure_png(figure, 200))
        parts.append((of, answers[-1], figure, _kind_rows(pair), _cards(home, pair, truth)))
        told = pair.targets.replace([np.inf, -np.inf], np.nan)  # empty: it has no alarm there
        tables.append(told.assign(tier=of.tier) if of.tier else told)
    write_whole(target / "targets.csv", pd.concat(tables).to_csv(index=False, float_format="%.6g"))
    write_whole(target / "table.tex", latex_table(ground, scores, opening_split(ground)))
    write_whole(target / "cite.bib", bibtex(ground))
    page = render(
        "paired.html",
        package="flgpr_ground",
        ground=ground,
        split=opening_split(ground),
        names=names,
        titles=titles,
        tiers=parts,
        side=2 * CHIP,
        halo=100 * ground.table.halo / CHIP,
    )
    write_page(target / "index.html", page)
    return target / "index.html", answers


def _has(home: Path, name: str, tier: Ground) -> bool:
    """Return whether an entry has alarms on a tier in the opening split."""
    file = entry_folder(home, name, tier) / opening_split(tier) / ALARMS
    return Folder(home).has(file.relative_to(home).as_posix())


def _pair(home: Path, tier: Ground, names: tuple[str, str], truth: pd.DataFrame) -> Pair:
    """Match the alarms of two entries on a tier to the targets of its lanes."""
    split = opening_split(tier)
    lanes = {lane.name: lane.lane for lane in tier.tested(split)}
    known = truth[truth["lane"].isin(list(lanes))].reset_index(drop=True)
    mines = chosen_mines(tier, split, known).to_numpy()
    body = known["body"].fillna("") if "body" in known else ""
    targets = known.assign(body=body).loc[mines, ["target_id", "lane", "kind", "body", "depth"]]
    matches = []
    for number, name in enumerate(names, 1):
        alarms = read_table_in(entry_folder(home, name, tier), f"{split}/{ALARMS}", "alarms")
        matched = match(alarms, known, lanes, tier.table.halo)
        matches.append(matched)
        targets[f"confidence_{number}"] = matched.best(mines)[1][mines]
        targets[f"far_{number}"] = found_from(matched, mines)
    return Pair(tier, names, (matches[0], matches[1]), mines, targets)


def _answer(pair: Pair) -> str:
    """Return what one entry misses and finds beside the other, with the difference of their Pd."""
    where = f"{pair.tier.tier_title}: " if pair.tier.tier else ""
    far = pair.tier.table.far
    (at_far,) = pair.differences([far])
    found = at_far | {"only": at_far["only_first"], "reference_only": at_far["only_second"]}
    return (
        f"{where}{paired_sentence(found, *pair.names)} Of {len(pair.targets)} mines, at {far:g} false "
        f"alarms per m², the difference of Pd is {at_far['difference']:+.2f} "
        f"({at_far['low']:+.2f} to {at_far['high']:+.2f})."
    )


def _kind_rows(pair: Pair) -> list[list[Any]]:
    """Return the rows of the table: mines by kind, and how many of them each of the two finds."""
    first, second = pair.found(1), pair.found(2)
    rows = []
    kinds = pair.targets["kind"].to_numpy()
    for kind in ["mines", *dict.fromkeys(kinds)]:
        of_kind = (kinds == kind) | (kind == "mines")
        counts = [of_kind, first, second, first & second, first & ~second, second & ~first]
        rows.append([kind_label(kind), *(int((of_kind & count).sum()) for count in counts)])
    return rows


def _cards(home: Path, pair: Pair, truth: pd.DataFrame) -> list[tuple[str, list[Score]]]:
    """Return the targets of every outcome with their chips, those that one alone finds first."""
    chips = dict(_chips(home, pair, truth.set_index("target_id")[["x", "y"]]))
    cards: dict[tuple[bool, bool], list[Score]] = {outcome: [] for outcome in _OUTCOMES}
    far = pair.tier.table.far
    for row in pair.targets.to_dict("records"):
        told = [_told(row, number) for number in (1, 2)]
        outcome = row["far_1"] <= far, row["far_2"] <= far
        cards[outcome].append({**row, "told": told, "chips": chips[row["target_id"]]})
    return [(_OUTCOMES[outcome].format(*pair.names), cards[outcome]) for outcome in _OUTCOMES]


def _told(row: Score, number: int) -> str:
    """Return what an entry makes of a target, in words."""
    if np.isinf(row[f"far_{number}"]):
        return "no alarm there"
    return f"confidence {row[f'confidence_{number}']:.3g}, from {row[f'far_{number}']:.3g} per m²"


def _chips(
    home: Path, pair: Pair, places: pd.DataFrame
) -> Iterator[tuple[str, list[tuple[str, bytes]]]]:
    """Yield the chips (name and PNG) of every target: the reference's image in its sub-band."""
    packaged = packaged_entries(pair.tier).get(pair.tier.table.reference)
    if packaged is None:  # the recipe of the second entry, as it ran
        other = Folder(entry_folder(home, pair.names[1], pair.tier))
        recipe = other.read("recipe.toml").decode()
    else:
        recipe = packaged.text
    for name, targets in pair.targets.groupby("lane"):
        data = pair.tier.lanes[str(name)].data(home / "lanes", recipe)
        view = data.image.sel(subband=parse_recipe(recipe).prescreen.subband)
        for target in targets["target_id"]:
            x, y = places.loc[target]
            labels = view["polarization"].values
            cut = [(str(label), _chip(view.sel(polarization=label), x, y)) for label in labels]
            yield str(target), cut


def _chip(view: xr.DataArray, x: float, y: float) -> bytes:
    """Return the PNG of the image about a place, in dB; few pixels of the lane are brighter."""
    level = view.copy(data=decibels(view))
    low, high = np.nanquantile(level, (0.5, 0.995))
    steps: FloatArray = np.arange(-CHIP, CHIP + 1e-9, float(np.diff(view["x"].values[:2])[0]))
    cut = level.reindex(x=x + steps, y=y + steps, method="nearest", tolerance=steps[1] - steps[0])
    stream = io.BytesIO()
    imsave(
        stream, cut.transpose("y", "x").values, vmin=low, vmax=high, cmap="gray", origin="lower",
        format="png", metadata={"Software": None},  # type: ignore[dict-item]
    )  # fmt: skip
    return stream.getvalue()
