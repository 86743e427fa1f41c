"""Scoring the entries side by side: every Pd with its interval, counts and what chance gives."""

from __future__ import annotations

import itertools
import json
import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from flgpr.door import Folder, read_named
from flgpr.report import render
from flgpr.scoring import (
    chance,
    clopper_pearson,
    match,
    operating_row,
    random_pd,
    roc_of,
)
from flgpr.scoring.comparison import paired_points
from flgpr.scoring.curve import held_pd_mean
from flgpr.scoring.matching import Match
from flgpr.store import sha256, write_whole
from flgpr.store.outputs import log_finished
from flgpr.store.tables import parse_columns, read_table_in
from flgpr.types import Entries
from flgpr_ground.card import entered_card, parse_card
from flgpr_ground.entries import ORACLES, packaged_entries
from flgpr_ground.figures import split_figure, tiers_figure
from flgpr_ground.ground import (
    BODY,
    MINES,
    Ground,
    Score,
    by_pd,
    load_ground,
    opening_split,
    scores_at,
)
from flgpr_ground.lanes import SEALED, common_ground, passphrase, same_lanes
from flgpr_ground.oracle import oracle_file
from flgpr_ground.running import ABOUT, ALARMS, entry_folder, measured_cost
from flgpr_trials.blind import match_blind
from flgpr_trials.ledger import alarm_hash

TOLD_APART = 0.05
"""Two entries are told apart by a p of the paired test below this."""
_KEY_DIGITS = 12  # of the digest in the name of a stored score


def score_entries(folders: Sequence[str | Path]) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Score all entries of benchmark folders.

    Those that were not scored yet look at the truth, which is logged.

    Parameters
    ----------
    folders : sequence of str or path
        What :func:`flgpr_ground.running.run_benchmark` wrote, of one form of the ground.

    Returns
    -------
    scores : DataFrame
        A row per entry, split, group of targets (``mines``, a site, a kind) and allowed FAR per m²:
        ``pd`` with ``pd_low``, ``pd_high`` (95 %, exact), counts, ``chance``, ``area`` (m²); at the
        FAR of comparison also mines that the entry alone finds (``only``), the reference alone
        (``reference_only``), and ``p`` of the paired test. Where targets lie too close to be moved
        clear of all halos, ``chance`` is that of alarms strewn at random at the same FAR. On a
        ground with tiers there is also a ``tier``; where the truth names bodies, there are groups
        of the targets with one body, ``body BODY``.
    costs : DataFrame
        A row per entry, and per ``tier`` where there are tiers: processor seconds per km in
        detection and of all trainings, the largest process in bytes.

    Raises
    ------
    ValueError
        If a folder is no benchmark's, or they are of different grounds.
    """
    benchmarks = [Path(folder) for folder in folders]
    ground = common_ground(benchmarks)
    rows: list[Entries] = []
    costs: list[Entries] = []
    for tier in ground.chosen_tiers():
        column = {"tier": tier.tier} if tier.tier else {}
        references = {
            split: _reference_alarms(benchmarks, tier, split) for split in tier.table.splits
        }
        for folder, name, entry in _entries(benchmarks, tier):
            for split, reference in references.items():
                if (entry / split / ALARMS).is_file():
                    score = _stored_score(tier, folder, name, split, reference)
                    rows += [column | row for row in score]
            card_text = entered_card(Folder(folder), name)
            card = None if card_text is None else parse_card(card_text)[0]
            if card is None:
                costs.append(column | measured_cost(tier, name, entry))
            else:
                costs.append(column | {"entry": name, **card.cost.declared()})
        for folder in benchmarks:
            if (folder / oracle_file(tier)).is_file():
                found = parse_columns(Folder(folder).read(oracle_file(tier)))
                rows += [column | row for row in _oracle_rows(tier, found)]
    if not rows:
        names = ", ".join(map(str, folders))
        raise ValueError(f"folders must hold entries that were run, got none in {names}")
    return pd.DataFrame(rows), pd.DataFrame(costs)


def _entries(folders: Sequence[Path], ground: Ground) -> Iterator[tuple[Path, str, Path]]:
    """Yield benchmark folder, name and own folder of the entries that began on a ground or tier."""
    for folder in folders:
        for path in sorted((folder / "entries").glob("*")):
            entry = entry_folder(folder, path.name, ground)
            if (entry / ABOUT).is_file():
                yield folder, path.name, entry


def _reference_alarms(folders: Sequence[Path], ground: Ground, split: str) -> pd.DataFrame | None:
    """Return the alarms of the reference in a split, from the first folder that has them."""
    for folder in folders:
        file = entry_folder(folder, ground.table.reference, ground) / split / ALARMS
        name = file.relative_to(folder).as_posix()
        if Folder(folder).has(name):
            return read_table_in(folder, name, "alarms")
    return None


def _stored_score(
    ground: Ground, folder: Path, name: str, split: str, reference: pd.DataFrame | None
) -> list[Entries]:
    """Return the score of an entry's alarms of a split.

    A score of the same alarms beside the same reference is read where it was stored.
    """
    entry = entry_folder(folder, name, ground)
    alarms = read_table_in(entry, f"{split}/{ALARMS}", "alarms")
    other = None if name == ground.table.reference else reference
    sealed = folder / "lanes" / SEALED
    score_name = f"{split}/score-{_score_key(ground, alarms, other, sealed)}.json"
    if not Folder(entry).has(score_name):
        lanes = [lane.name for lane in ground.tested(split)]
        look = match_blind(alarms, sealed, passphrase(ground), only_lanes=lanes)
        matched = look.matched
        paired = None
        if other is not None:
            # The reference's own score was logged when it was scored; here it is only paired.
            paired = match(other, matched.truth, matched.lanes, matched.halo)
        rows = list(_rows(ground, split, matched, paired))
        write_whole(entry / score_name, json.dumps(rows) + "\n")
    return [{"entry": name, "split": split} | row for row in Folder(entry).json(score_name)]


def _score_key(
    ground: Ground, alarms: pd.DataFrame, other: pd.DataFrame | None, sealed: Path
) -> str:
    """Return a digest of all that a score depends on."""
    # Without tiers nothing is said of them, so that scores from before there were tiers are found.
    excluded = None if ground.table.tiers else {"tiers"}
    rules = ground.table.model_dump(mode="json", exclude=excluded)
    # Without a reference it is false, not null, as in the keys of scores stored so far.
    other_hash = False if other is None else alarm_hash(other)
    truth_hash = sha256(Folder(sealed.parent).read(sealed.name))
    text = json.dumps([[rules, alarm_hash(alarms), other_hash], truth_hash])
    return sha256(text.encode())[:_KEY_DIGITS]


def _rows(ground: Ground, split: str, matched: Match, reference: Match | None) -> Iterator[Entries]:
    """Yield the score of all mines, of kinds of targets and packaged bodies, and of every site."""
    groups = _groups(ground, split, matched.truth)
    for group, of_group in groups.items():
        paired = reference if group == MINES else None
        yield from _points(ground, group, matched, of_group.to_numpy(), paired)

    sites = {lane.name: lane.site for lane in ground.tested(split)}
    for site in ground.sites:
        lanes = [name for name, of_lane in sites.items() if of_lane == site]
        if not (groups[MINES] & matched.truth["lane"].isin(lanes)).any():
            continue
        # Matched again: false alarms and area are those of the site's lanes alone.
        at_site = in_lanes(matched, lanes)
        mines = chosen_mines(ground, split, at_site.truth).to_numpy()
        yield from _points(ground, site, at_site, mines)


def in_lanes(matched: Match, lanes: Sequence[str]) -> Match:
    """Return the match of some of the lanes alone.

    Parameters
    ----------
    matched : Match
        The match of all lanes.
    lanes : sequence of str
        Names of those that are kept, with their own false alarms and area.
    """
    alarms, truth = (
        table[table["lane"].isin(lanes)].reset_index(drop=True)
        for table in (matched.alarms, matched.truth)
    )
    return match(alarms, truth, {name: matched.lanes[name] for name in lanes}, matched.halo)


def _groups(ground: Ground, split: str, targets: pd.DataFrame) -> dict[str, pd.Series]:
    """Return which targets are in each group: all mines, every kind, every packaged body."""
    kind = targets["kind"].astype(str)
    groups = {MINES: chosen_mines(ground, split, targets)}
    groups |= {name: kind == name for name in sorted(kind.unique())}
    if "body" in targets.columns:
        body = targets["body"].fillna("").astype(str)
        groups |= {f"{BODY}{name}": body == name for name in sorted(set(body) - {""})}
    return groups


def chosen_mines(ground: Ground, split: str, targets: pd.DataFrame) -> pd.Series:
    """Return which targets are the mines that a split is scored on, by their kinds."""
    kind = targets["kind"].astype(str)
    kinds = ground.table.splits[split].kinds
    return kind.isin(kinds) if kinds else kind != "simulant"


def _oracle_rows(ground: Ground, false_alarms: pd.DataFrame) -> Iterator[Entries]:
    """Yield the score of both oracles in the splits whose targets they know.

    Chance is that of strewn alarms.
    """
    halo = ground.table.halo
    for name, split in itertools.product(ORACLES, ground.table.splits):
        tested = {lane.name for lane in ground.tested(split) if not lane.empty}
        targets = false_alarms[false_alarms["lane"].isin(tested)]
        if set(targets["lane"]) != tested:
            continue
        column, _ = ORACLES[name]
        area = float(targets.drop_duplicates("site")["area"].sum())
        groups = _groups(ground, split, targets)
        groups |= {site: groups[MINES] & (targets["site"] == site) for site in ground.sites}
        for (group, rows), allowed in itertools.product(groups.items(), ground.table.fars):
            detected = int((targets.loc[rows, column] <= allowed).sum())
            total = int(rows.sum())
            low, high = clopper_pearson(detected, total)
            yield {
                "entry": name,
                "split": split,
                "group": group,
                "far_allowed": allowed,
                "pd": detected / total,
                "pd_low": low,
                "pd_high": high,
                "n_detected": detected,
                "n_targets": total,
                # Alarms strewn by a Poisson process: one at least in the halo.
                "chance": float(random_pd(allowed, halo)),
                "far": allowed,
                "n_false": int(allowed * area),
                "area": area,
            }


def _points(
    ground: Ground, group: str, matched: Match, rows: Any, reference: Match | None = None
) -> Iterator[Entries]:
    """Yield the score of a group of targets at every allowed FAR."""
    curve = chance(matched).add_chance_column(roc_of(matched, rows), rows)
    fars = ground.table.fars
    points = curve.iloc[operating_row(curve, np.array(fars))].to_dict("records")
    for allowed, point in zip(fars, points, strict=True):
        row: Entries = {"group": group, "far_allowed": allowed}
        row |= {name: float(point[name]) for name in ("pd", "pd_low", "pd_high", "chance", "far")}
        if math.isnan(row["chance"]):
            # The targets lie too close to be moved clear of all halos.
            row["chance"] = float(random_pd(row["far"], matched.halo))
        row |= {name: int(point[name]) for name in ("n_detected", "n_targets", "n_false")}
        row["area"] = float(curve.attrs["area"])
        if allowed == ground.table.far:
            row["pd_mean"] = float(held_pd_mean(curve, max(fars)))
            if reference is not None:
                (paired,) = paired_points(matched, reference, [allowed], rows)
                row["only"] = paired["only_first"]
                row["reference_only"] = paired["only_second"]
                row["p"] = paired["p"]
        yield row


def table_text(ground: Ground, scores: pd.DataFrame, costs: pd.DataFrame) -> str:
    """Return the table of all mines at the FAR of comparison, as text.

    Parameters
    ----------
    ground : Ground
        The ground with all of its tiers.
    scores, costs : DataFrame
        What :func:`score_entries` returns.

    Returns
    -------
    str
        Lines for every tier and split, the largest Pd first, and lines of costs.
    """
    width = max(20, *(len(name) for name in scores["entry"]))
    lines = [
        f"{ground.title}: Pd of mines at {ground.table.far:g} false alarms per m², 95 % interval, "
        "chance"
    ]
    against = f"; against {ground.table.reference} "
    for tier in ground.chosen_tiers():
        if tier.tier and not (scores["tier"] == tier.tier).any():
            continue
        lines += ["", f"TIER {tier.tier}: {tier.tier_title}"] if tier.tier else []
        for split, row in tier.table.splits.items():
            lines += ["", f"{split}: {row.title}"]
            for score in by_pd(scores_at(scores, tier, split)).to_dict("records"):
                entry = f"  {score['entry']:{width}} {pd_in_words(score)}"
                lines.append(entry + paired_in_words(score, against))

    tier_width = max((len(name) for name in ground.table.tiers), default=0)
    head = f"{'cost':{width + 2}} {'':{tier_width}}"
    lines += ["", f"{head} processor s/km  training s  largest process MiB"]
    # What did not finish cost nothing that was measured.
    for cost in costs[costs["entry"].isin(scores["entry"])].to_dict("records"):
        name = f"  {cost['entry']:{width}} {cost.get('tier', ''):{tier_width}}"
        seconds, training, peak_mib = costs_in_words(cost)
        lines.append(f"{name} {seconds:>14} {training:>11} {peak_mib:>20}")
    return "\n".join(lines)


def costs_in_words(cost: Score) -> list[str]:
    """Return seconds per km, seconds of training and MiB as text; "-" for what is not known."""
    values = [cost["seconds_per_km"], cost["training_seconds"], cost["peak_bytes"] / 2**20]
    return [f"{value:.0f}" if np.isfinite(value) else "-" for value in values]


def pd_in_words(score: Score) -> str:
    """Return a Pd with its interval, counts and chance, as text."""
    interval = f"({score['pd_low']:.2f} to {score['pd_high']:.2f})"
    counts = f"{score['n_detected']:.0f} of {score['n_targets']:.0f}, {score['n_false']:.0f} false"
    return f"{score['pd']:.2f} {interval}, {counts}, chance {score['chance']:.2f}"


def paired_in_words(score: Score, before: str = "") -> str:
    """Return the paired comparison with the reference as text; "" for the reference itself."""
    if pd.isna(score.get("p")):
        return ""
    return f"{before}+{score['only']:.0f} -{score['reference_only']:.0f}, p = {score['p']:.2g}"


def paired_sentence(score: Score, entry: str, reference: str) -> str:
    """Return what an entry misses and finds beside another, as a sentence; "" without a pair."""
    if pd.isna(score.get("p")):
        return ""
    missed, found = score["reference_only"], score["only"]
    return (
        f"{entry} misses {missed:.0f} {'mine' if missed == 1 else 'mines'} that {reference} finds, "
        f"and finds {found:.0f} that {reference} misses (McNemar p = {score['p']:.2g})."
    )


def best_sentence(tier: Ground, scores: pd.DataFrame) -> str:
    """Return which entry finds most mines, and whether the reference is told apart from it.

    Parameters
    ----------
    tier : Ground
        A tier, or a ground without tiers.
    scores : DataFrame
        What :func:`score_entries` returns.

    Returns
    -------
    str
        A sentence, of the opening split at the FAR of comparison; "" where no detector was scored.
        Told apart is what has a p below 0.05 in the paired test, which knows nothing of the choice
        of the best.
    """
    entered = scores_at(scores, tier, opening_split(tier))
    ranked = by_pd(entered[~entered["entry"].isin(list(ORACLES))])
    if ranked.empty:
        return ""
    best = ranked.iloc[0].to_dict()
    tied = (ranked["pd"] == best["pd"]).sum() - 1
    others = f", as {'does one other' if tied == 1 else f'do {tied} others'}" if tied else ""
    return (
        f"{best['entry']} finds most{others}: {best['n_detected']:.0f} of {best['n_targets']:.0f} "
        f"mines at {tier.table.far:g} false alarms per m², Pd {best['pd']:.2f} "
        f"({best['pd_low']:.2f} to {best['pd_high']:.2f})"
        f"{beside_reference(best, tier.table.reference)}."
    )


def beside_reference(score: Score, reference: str) -> str:
    """Return whether an entry is told apart from the reference, to end a sentence."""
    if score["entry"] == reference:
        return "; it is the reference"
    if pd.isna(score.get("p")):
        return f"; not compared with {reference}"
    told = "told apart" if score["p"] < TOLD_APART else "not told apart"
    return f"; {told} from the reference {reference} (McNemar p = {score['p']:.2g})"


def write_score_tables(folders: Sequence[str | Path], output: str | Path) -> str:
    """Score what is not scored yet, and write the tables and the page.

    Parameters
    ----------
    folders : sequence of str or path
        Folders of ``flgpr benchmark run``.
    output : str or path
        Folder that takes ``scores.csv``, the same, to the digit, for the same alarms, ``costs.csv``
        of what this machine took, and ``index.html``.

    Returns
    -------
    str
        The table as text.

    Raises
    ------
    ValueError
        As of :func:`score_entries`.
    """
    benchmarks = [Path(folder) for folder in folders]
    target = Path(output)
    scores, costs = score_entries(benchmarks)
    ground = common_ground(benchmarks)
    target.mkdir(parents=True, exist_ok=True)
    write_whole(target / "scores.csv", scores.to_csv(index=False, float_format="%.6g"))
    write_whole(target / "costs.csv", costs.to_csv(index=False, float_format="%.4g"))
    titles, faults, own = described(ground, benchmarks)
    titles |= {name: title for name, (_, title) in ORACLES.items() if name in set(scores["entry"])}
    opening = scores_at(scores, ground, opening_split(ground))
    told = []
    for score in opening[opening["entry"].isin(own)].to_dict("records"):
        words = paired_sentence(score, score["entry"], ground.table.reference)
        told.append((score.get("tier"), words))
    told += [(tier.tier, best_sentence(tier, scores)) for tier in ground.chosen_tiers()]
    answers = [f"{tier}: {words}" if ground.table.tiers else words for tier, words in told if words]
    write_page(target / "index.html", _page(ground, scores, costs, titles, answers))
    return "\n".join([*answers, table_text(ground, scores, costs), *faults])


def write_page(path: Path, page: str) -> None:
    """Write a page, and report if it was there."""
    if path.is_file() and read_named(path).decode("utf-8", "replace") == page:
        log_finished(path)
    write_whole(path, page)  # leaves a file of the same bytes as it is


def described(
    ground: Ground, folders: Sequence[Path]
) -> tuple[dict[str, str], list[str], list[str]]:
    """Describe the entries that began in benchmark folders.

    Parameters
    ----------
    ground : Ground
        The ground with all of its tiers.
    folders : sequence of Path
        Folders of ``flgpr benchmark run``.

    Returns
    -------
    titles : dict of str to str
        What each entry is.
    faults : list of str
        Which did not finish, and why; each begins with the name of the entry.
    own : list of str
        Those that are classes of one's own.
    """
    titles: dict[str, str] = {}
    faults = []
    own = []
    for tier in ground.chosen_tiers():
        on_tier = f" on the tier {tier.tier}" if tier.tier else ""
        for _, name, entry in _entries(folders, tier):
            about = Folder(entry).json(ABOUT)
            titles.setdefault(name, about["title"])
            if "authors" in about:
                own.append(name)
            if about["fault"]:
                reason = f"did not finish{on_tier}: {about['fault']}"
                titles[name] += f"; {reason}"
                faults.append(f"{name} {reason}")
    return titles, faults, own


def _page(
    ground: Ground,
    scores: pd.DataFrame,
    costs: pd.DataFrame,
    titles: Mapping[str, str],
    answers: Sequence[str],
) -> str:
    """Return the page of all tiers, which begins with the answers."""
    opening = {}
    if ground.table.tiers:
        opening["wide"] = tiers_figure(ground, scores)
        opening["narrow"] = tiers_figure(ground, scores, narrow=True)
    tiers = []
    for tier in ground.chosen_tiers():
        splits = []
        for split in tier.table.splits:
            ranked = by_pd(scores_at(scores, tier, split))
            if ranked.empty:
                continue
            by_entry: dict[str, dict[float, Score]] = {name: {} for name in ranked["entry"]}
            for far in ground.table.fars:
                for row in scores_at(scores, tier, split, far=far).to_dict("records"):
                    by_entry[row["entry"]][far] = row
            splits.append((split, split_figure(tier, scores, split), by_entry))
        if splits:
            tiers.append((tier, splits))
    return render(
        "benchmark.html",
        package="flgpr_ground",
        ground=ground,
        answers=answers,
        opening=opening,
        opening_split=opening_split(ground),
        tiers=tiers,
        titles=titles,
        costs=costs.to_dict("records"),
        costs_in_words=costs_in_words,
        pd_in_words=pd_in_words,
        paired_in_words=paired_in_words,
    )


def listing(
    quick: bool = False, lanes: str | Path | None = None, ground: str | Path | None = None
) -> list[str]:
    """Return lines that list the entries, the lanes and the splits.

    Parameters
    ----------
    quick : bool
        Whether to list the quick form.
    lanes : str or path, optional
        Folder of lanes to compare with those whose fingerprints come with the package. They are the
        same bits, alike (the rms of the echoes of every polarization within 1e-4), or other lanes.
    ground : str or path, optional
        Name of a packaged ground, by default the newest, or a file.

    Returns
    -------
    list of str
        The lines.
    """
    chosen = load_ground(quick, ground)
    lines = [f"{chosen.title}, seen by {chosen.table.sensor}", "", "entries:"]
    lines += [f"  {name:20} {entry.title}" for name, entry in packaged_entries(chosen).items()]
    if chosen.table.tiers:
        lines += ["", "tiers, each with all splits:"]
        for name, tier in chosen.table.tiers.items():
            sites = ", ".join(tier.sites.values())
            lines.append(f"  {name:20} {tier.title}, at {sites}")
    lines += ["", "splits:"]
    lines += [f"  {name:20} {split.title}" for name, split in chosen.table.splits.items()]
    lines += ["", "lanes:"]
    likeness = same_lanes(chosen, Path(lanes)) if lanes is not None else {}
    width = max(20, *(len(name) for name in chosen.lanes))
    for name, lane in chosen.lanes.items():
        line = f"  {name:{width}} {lane.part:9} {lane.length:5g} m {len(lane.truth()):3} targets"
        lines.append(f"{line}  {likeness[name]}" if likeness else line)
    return lines
