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
    pd_mean,
    random_pd,
    roc_of,
)
from flgpr.scoring.comparison import paired_points
from flgpr.scoring.matching import Match
from flgpr.store import sha256, write_whole
from flgpr.store.outputs import log_finished
from flgpr.store.tables import parse_columns, read_table_in
from flgpr_ground.card import entered_card, parse_card
from flgpr_ground.entries import ORACLES, packaged_entries
from flgpr_ground.figures import opening_split, split_figure, tiers_figure
from flgpr_ground.fingerprints import same_lanes
from flgpr_ground.ground import BODY, MINES, Ground, load_ground
from flgpr_ground.oracle import oracle_file
from flgpr_ground.running import (
    ABOUT,
    ALARMS,
    SEALED,
    common_ground,
    entry_folder,
    measured_cost,
    passphrase,
)
from flgpr_trials.blind import match_blind
from flgpr_trials.ledger import alarm_hash

_COUNTS = ("n_detected", "n_targets", "n_false")
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
    rows: list[dict[str, Any]] = []
    costs: list[dict[str, Any]] = []
    for tier in ground.chosen_tiers():
        tier_rows, tier_costs = _score_tier(tier, benchmarks)
        tier_column = {"tier": tier.tier} if tier.tier else {}
        rows += [tier_column | row for row in tier_rows]
        costs += [tier_column | row for row in tier_costs]
    scores = pd.DataFrame(rows)
    if scores.empty:
        names = ", ".join(map(str, folders))
        raise ValueError(f"folders must hold entries that were run, got none in {names}")
    return scores, pd.DataFrame(costs)


def _score_tier(
    ground: Ground, folders: Sequence[Path]
) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """Return the rows of scores and of costs of a ground, or of one of its tiers."""
    reference = {}
    for split in ground.table.splits:
        reference[split] = _reference_alarms(folders, ground, split)
    rows: list[dict[str, Any]] = []
    costs = []
    for folder, name in _entries(folders, ground):
        entry = entry_folder(folder, name, ground)
        for split in ground.table.splits:
            if (entry / split / ALARMS).is_file():
                rows += _stored_score(ground, folder, name, split, reference[split])
        cost = _declared_cost(folder, name)
        if cost is None:
            cost = measured_cost(ground, name, entry)
        costs.append(cost)

    oracle_name = oracle_file(ground)
    for folder in folders:
        if (folder / oracle_name).is_file():
            table = parse_columns(Folder(folder).read(oracle_name))
            rows += _oracle_rows(ground, table)
    return rows, costs


def _entries(folders: Sequence[Path], ground: Ground) -> Iterator[tuple[Path, str]]:
    """Yield folder and name of the entries that began on a ground, or on one of its tiers."""
    for folder in folders:
        for path in sorted((folder / "entries").glob("*")):
            if (entry_folder(folder, path.name, ground) / ABOUT).is_file():
                yield folder, path.name


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
) -> list[dict[str, Any]]:
    """Return the score of an entry's alarms of a split.

    A score of the same alarms beside the same reference is read where it was stored.
    """
    entry = entry_folder(folder, name, ground)
    alarms = read_table_in(entry, f"{split}/{ALARMS}", "alarms")
    is_reference = name == ground.table.reference
    other = None if is_reference else reference
    sealed = folder / "lanes" / SEALED
    score_key = _score_key(ground, alarms, other, sealed)
    score_name = f"{split}/score-{score_key}.json"
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
    entry_columns = {"entry": name, "split": split}
    return [entry_columns | row for row in Folder(entry).json(score_name)]


def _score_key(
    ground: Ground, alarms: pd.DataFrame, other: pd.DataFrame | None, sealed: Path
) -> str:
    """Return a digest of all that a score depends on."""
    # Without tiers nothing is said of them, so that scores from before there were tiers are found.
    excluded = None if ground.table.tiers else {"tiers"}
    rules = ground.table.model_dump(mode="json", exclude=excluded)
    # Without a reference it is false, not null, as in the keys of scores stored so far.
    other_hash = False if other is None else alarm_hash(other)
    alarms_and_rules = [rules, alarm_hash(alarms), other_hash]
    truth_hash = sha256(Folder(sealed.parent).read(sealed.name))
    text = json.dumps([alarms_and_rules, truth_hash])
    return sha256(text.encode())[:_KEY_DIGITS]


def _rows(
    ground: Ground, split: str, matched: Match, reference: Match | None
) -> Iterator[dict[str, Any]]:
    """Yield the score of all mines, of kinds of targets and packaged bodies, and of every site."""
    level = chance(matched)
    groups = _groups(ground, split, matched.truth)
    mines = groups[MINES]
    for group, of_group in groups.items():
        paired = reference if group == MINES else None
        yield from _points(ground, group, matched, level, of_group.to_numpy(), paired)

    site_of_lane = {lane.name: lane.site for lane in ground.tested(split)}
    site_of_target = matched.truth["lane"].map(site_of_lane)
    for site in ground.sites:
        lanes = [name for name, site_of in site_of_lane.items() if site_of == site]
        has_mines = (mines & (site_of_target == site)).any()
        if not lanes or not has_mines:
            continue
        # Matched again: false alarms and area are those of the site's lanes alone.
        at_site = _match_of_lanes(matched, lanes)
        rows = chosen_mines(ground, split, at_site.truth).to_numpy()
        yield from _points(ground, site, at_site, chance(at_site), rows, None)


def _groups(ground: Ground, split: str, targets: pd.DataFrame) -> dict[str, pd.Series]:
    """Return which targets are in each group: all mines, every kind, every packaged body."""
    kind = targets["kind"].astype(str)
    groups = {MINES: chosen_mines(ground, split, targets)}
    for name in sorted(kind.unique()):
        groups[name] = kind == name
    if "body" in targets.columns:
        body = targets["body"].fillna("").astype(str)
        for name in sorted(set(body) - {""}):
            groups[f"{BODY}{name}"] = body == name
    return groups


def chosen_mines(ground: Ground, split: str, targets: pd.DataFrame) -> pd.Series:
    """Return which targets are the mines that a split is scored on, by their kinds."""
    kind = targets["kind"].astype(str)
    kinds = ground.table.splits[split].kinds
    return kind.isin(kinds) if kinds else kind != "simulant"


def _oracle_rows(ground: Ground, false_alarms: pd.DataFrame) -> Iterator[dict[str, Any]]:
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
        for site in ground.sites:
            groups[site] = groups[MINES] & (targets["site"] == site)
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


def _match_of_lanes(matched: Match, lanes: Sequence[str]) -> Match:
    """Return the match of some of the lanes alone."""

    def of_lanes(table: pd.DataFrame) -> pd.DataFrame:
        return table[table["lane"].isin(lanes)].reset_index(drop=True)

    borders = {name: matched.lanes[name] for name in lanes}
    return match(of_lanes(matched.alarms), of_lanes(matched.truth), borders, matched.halo)


def _points(
    ground: Ground, group: str, matched: Match, level: Any, rows: Any, reference: Match | None
) -> Iterator[dict[str, Any]]:
    """Yield the score of a group of targets at every allowed FAR."""
    curve = level.add_chance_column(roc_of(matched, rows), rows)
    fars = ground.table.fars
    points = curve.iloc[operating_row(curve, np.array(fars))]
    for allowed, (_, point) in zip(fars, points.iterrows(), strict=True):
        row: dict[str, Any] = {"group": group, "far_allowed": allowed}
        for name in ("pd", "pd_low", "pd_high", "chance", "far"):
            row[name] = float(point[name])
        if math.isnan(row["chance"]):
            # The targets lie too close to be moved clear of all halos.
            row["chance"] = float(random_pd(row["far"], matched.halo))
        for name in _COUNTS:
            row[name] = int(point[name])
        row["area"] = float(curve.attrs["area"])
        if allowed == ground.table.far:
            row["pd_mean"] = float(pd_mean(curve, max(fars)))
            if reference is not None:
                (paired,) = paired_points(matched, reference, [allowed], rows)
                row["only"] = paired["only_first"]
                row["reference_only"] = paired["only_second"]
                row["p"] = paired["p"]
        yield row


def _declared_cost(folder: Path, name: str) -> dict[str, Any] | None:
    """Return what a submission cost by its card; None for an entry without one."""
    card_text = entered_card(Folder(folder), name)
    if card_text is None:
        return None
    card, _ = parse_card(card_text)
    return None if card is None else {"entry": name, **card.cost.declared()}


def of_tier(table: pd.DataFrame, ground: Ground) -> pd.DataFrame:
    """Return the rows of scores or of costs that are of a tier.

    On a ground without tiers these are all rows.
    """
    return table[table["tier"] == ground.tier] if ground.tier else table


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
    for tier in ground.chosen_tiers():
        tier_scores = of_tier(scores, tier)
        if len(tier_scores):
            lines += _tier_lines(tier, tier_scores, width)

    tier_width = max((len(name) for name in ground.table.tiers), default=0)
    head = f"{'cost':{width + 2}} {'':{tier_width}}"
    lines += ["", f"{head} processor s/km  training s  largest process MiB"]
    for cost in costs.to_dict("records"):
        name = f"  {cost['entry']:{width}} {cost.get('tier', ''):{tier_width}}"
        seconds, training, peak_mib = costs_in_words(cost)
        lines.append(f"{name} {seconds:>14} {training:>11} {peak_mib:>20}")
    return "\n".join(lines)


def costs_in_words(cost: Mapping[Any, Any]) -> list[str]:
    """Return seconds per km, seconds of training and MiB as text; "-" for what is not known."""
    values = [cost["seconds_per_km"], cost["training_seconds"], cost["peak_bytes"] / 2**20]
    return [f"{value:.0f}" if np.isfinite(value) else "-" for value in values]


def _tier_lines(ground: Ground, scores: pd.DataFrame, width: int) -> list[str]:
    """Return the lines of every split of a ground, or of one of its tiers; names have a width."""
    lines = ["", f"TIER {ground.tier}: {ground.tier_title}"] if ground.tier else []
    is_compared = scores["group"] == MINES
    is_compared &= scores["far_allowed"] == ground.table.far
    compared = scores[is_compared]
    against = f"; against {ground.table.reference} "
    for split, row in ground.table.splits.items():
        lines += ["", f"{split}: {row.title}"]
        of_split = compared[compared["split"] == split]
        ranked = of_split.sort_values("pd", ascending=False, kind="stable")
        for score in ranked.to_dict("records"):
            entry = f"  {score['entry']:{width}} {pd_in_words(score)}"
            lines.append(entry + paired_in_words(score, against))
    return lines


def pd_in_words(score: Mapping[Any, Any]) -> str:
    """Return a Pd with its interval, counts and chance, as text."""
    interval = f"({score['pd_low']:.2f} to {score['pd_high']:.2f})"
    counts = f"{score['n_detected']:.0f} of {score['n_targets']:.0f}, {score['n_false']:.0f} false"
    return f"{score['pd']:.2f} {interval}, {counts}, chance {score['chance']:.2f}"


def paired_in_words(score: Mapping[Any, Any], before: str = "") -> str:
    """Return the paired comparison with the reference as text; "" for the reference itself."""
    p = score.get("p")
    if p is None or not np.isfinite(p):
        return ""
    return f"{before}+{score['only']:.0f} -{score['reference_only']:.0f}, p = {p:.2g}"


def paired_sentence(score: Mapping[Any, Any], entry: str, reference: str) -> str:
    """Return what an entry misses and finds beside another, as a sentence; "" without a pair."""
    p = score.get("p")
    if p is None or not np.isfinite(p):
        return ""
    missed, found = score["reference_only"], score["only"]
    return (
        f"{entry} misses {missed:.0f} {'mine' if missed == 1 else 'mines'} that {reference} finds, "
        f"and finds {found:.0f} that {reference} misses (McNemar p = {p:.2g})."
    )


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
    titles, faults, own = _described(ground, benchmarks)
    for name, (_, title) in ORACLES.items():
        if name in set(scores["entry"]):
            titles[name] = title
    answers = list(_answers(ground, scores, own))
    write_page(target / "index.html", _page(ground, scores, costs, titles, answers))
    return "\n".join([*answers, table_text(ground, scores, costs), *faults])


def _answers(ground: Ground, scores: pd.DataFrame, own: Sequence[str]) -> Iterator[str]:
    """Yield a sentence for every entry of one's own, on every tier, in the opening split."""
    is_answer = scores["entry"].isin(own) & (scores["split"] == opening_split(ground))
    is_answer &= (scores["group"] == MINES) & (scores["far_allowed"] == ground.table.far)
    for score in scores[is_answer].to_dict("records"):
        words = paired_sentence(score, score["entry"], ground.table.reference)
        if words:
            where = f"{score['tier']}: " if ground.table.tiers else ""
            yield f"{where}{words}"


def write_page(path: Path, page: str) -> None:
    """Write a page, and report if it was there."""
    if path.is_file() and read_named(path).decode("utf-8", "replace") == page:
        log_finished(path)
    write_whole(path, page)  # leaves a file of the same bytes as it is


def _described(
    ground: Ground, folders: Sequence[Path]
) -> tuple[dict[str, str], list[str], list[str]]:
    """Return titles by entry, the reasons of those that did not finish, and those of one's own."""
    titles: dict[str, str] = {}
    faults = []
    own = []
    for tier in ground.chosen_tiers():
        on_tier = f" on the tier {tier.tier}" if tier.tier else ""
        for folder, name in _entries(folders, tier):
            entry = entry_folder(folder, name, tier)
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
        tier_scores = of_tier(scores, tier)
        splits = []
        for split in ground.table.splits:
            if (tier_scores["split"] == split).any():
                figure = split_figure(tier, tier_scores, split)
                splits.append((split, figure, _scores_of_entries(tier, tier_scores, split)))
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


def _scores_of_entries(
    ground: Ground, scores: pd.DataFrame, split: str
) -> dict[str, dict[float, dict[Any, Any]]]:
    """Return the scores of all mines by entry and FAR, the largest Pd at that of comparison first."""
    mines = scores[(scores["split"] == split) & (scores["group"] == MINES)]
    compared = mines[mines["far_allowed"] == ground.table.far]
    ranked = compared.sort_values("pd", ascending=False, kind="stable")
    by_entry: dict[str, dict[float, dict[Any, Any]]] = {str(name): {} for name in ranked["entry"]}
    for row in mines.to_dict("records"):
        by_entry[str(row["entry"])][row["far_allowed"]] = row
    return by_entry


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
    chosen = load_ground(quick, None if ground is None else Path(ground))
    lines = [f"{chosen.title}, seen by {chosen.table.sensor}", "", "entries:"]
    for name, entry in packaged_entries(chosen).items():
        lines.append(f"  {name:20} {entry.title}")
    if chosen.table.tiers:
        lines += ["", "tiers, each with all splits:"]
        for name, tier in chosen.table.tiers.items():
            sites = ", ".join(tier.sites.values())
            lines.append(f"  {name:20} {tier.title}, at {sites}")
    lines += ["", "splits:"]
    for name, split in chosen.table.splits.items():
        lines.append(f"  {name:20} {split.title}")
    lines += ["", "lanes:"]
    likeness = same_lanes(chosen, Path(lanes)) if lanes is not None else {}
    width = max(20, *(len(name) for name in chosen.lanes))
    for name, lane in chosen.lanes.items():
        targets = len(lane.truth())
        line = f"  {name:{width}} {lane.part:9} {lane.length:5g} m {targets:3} targets"
        if likeness:
            line += f"  {likeness[name]}"
        lines.append(line)
    return lines
