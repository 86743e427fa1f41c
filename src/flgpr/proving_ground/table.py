"""Scoring what entered and setting it side by side: every Pd with its interval, its counts and what chance gives."""

from __future__ import annotations

import io
import itertools
import json
import math
from collections.abc import Iterator, Mapping, Sequence
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from flgpr.door import Folder, read_named
from flgpr.proving_ground.figures import opening_split, split_figure, tiers_figure
from flgpr.proving_ground.ground import BODY, MINES, Ground, load_ground
from flgpr.proving_ground.oracle import oracle_file
from flgpr.proving_ground.running import (
    ABOUT,
    ALARMS,
    ORACLES,
    PRINTS,
    SEALED,
    entry_folder,
    packaged_entries,
    passphrase,
    read_costs,
    read_ground,
)
from flgpr.report import render
from flgpr.scoring import chance, clopper_pearson, compare, match, operating_row, pd_mean, roc_of
from flgpr.scoring.matching import Match
from flgpr.store import sha256, write_whole
from flgpr.store.files import existing
from flgpr.store.outputs import tell_finished
from flgpr.store.tables import parse_columns, read_table_in
from flgpr.trials import alarm_hash
from flgpr.trials.blind import match_blind

_COUNTS = ("n_detected", "n_targets", "n_false")


def score_entries(folders: Sequence[str | Path]) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Score all entries of benchmark folders that were not scored yet, each time a look at the truth that is logged.

    Parameters
    ----------
    folders : sequence of str or path
        What :func:`flgpr.proving_ground.running.run_benchmark` wrote, of one form of the ground.

    Returns
    -------
    scores : DataFrame
        A row per entry, split, group of targets (``mines``, a site, a kind) and allowed FAR per m²:
        ``pd`` with ``pd_low``, ``pd_high`` (95 %, exact), counts, ``chance``, ``area`` (m²); at the
        FAR of comparison also mines that the entry alone finds (``only``), the reference alone
        (``reference_only``), and ``p`` of the paired test. On a ground with tiers also a ``tier``,
        and groups of the targets with one packaged body, ``body BODY``.
    costs : DataFrame
        A row per entry, and per ``tier`` where there are tiers: processor seconds per km in
        detection and of all trainings, the largest process in bytes.

    Raises
    ------
    ValueError
        If a folder is no benchmark's, or they are of different grounds.
    """
    homes = [Path(folder) for folder in folders]
    ground = _ground_of(homes)
    rows: list[dict[str, Any]] = []
    costs: list[dict[str, Any]] = []
    for tier in ground.chosen_tiers():
        tier_rows, tier_costs = _score_tier(tier, homes)
        about = {"tier": tier.tier} if tier.tier else {}
        rows += [about | row for row in tier_rows]
        costs += [about | row for row in tier_costs]
    scores = pd.DataFrame(rows)
    if scores.empty:
        raise ValueError(
            f"folders must hold entries that were run, got none in {', '.join(map(str, folders))}"
        )
    return scores, pd.DataFrame(costs)


def _score_tier(
    ground: Ground, homes: Sequence[Path]
) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """Score all entries and the oracle on a ground or on one of its tiers: rows of scores and of costs."""
    reference = {split: _alarms_of(homes, ground, split) for split in ground.table.splits}
    rows: list[dict[str, Any]] = []
    costs = []
    for home, name in _entries(homes, ground):
        entry = entry_folder(home, name, ground)
        for split in ground.table.splits:
            if (entry / split / ALARMS).is_file():
                rows += _kept_score(ground, home, name, split, reference[split])
        costs.append(_cost(ground, name, entry))
    for home in homes:
        if (home / oracle_file(ground)).is_file():
            rows += _oracle_rows(ground, parse_columns(Folder(home).read(oracle_file(ground))))
    return rows, costs


def _ground_of(homes: Sequence[Path]) -> Ground:
    grounds = [read_ground(home) for home in homes]
    if any(one != grounds[0] for one in grounds):
        raise ValueError(
            f"folders must all be of one ground, got {', '.join(one.title for one in grounds)}"
        )
    return grounds[0]


def _entries(homes: Sequence[Path], ground: Ground) -> Iterator[tuple[Path, str]]:
    """Find the entries that began on a ground, or on one of its tiers: the benchmark's folder and their names."""
    for home in homes:
        for own in sorted((home / "entries").glob("*")):
            if (entry_folder(home, own.name, ground) / ABOUT).is_file():
                yield home, own.name


def _alarms_of(homes: Sequence[Path], ground: Ground, split: str) -> pd.DataFrame | None:
    """Alarms of the reference in a split, from the first folder that has them."""
    for home in homes:
        file = entry_folder(home, ground.table.reference, ground) / split / ALARMS
        name = file.relative_to(home).as_posix()
        if Folder(home).has(name):
            return read_table_in(home, name, "alarms")
    return None


def _kept_score(
    ground: Ground, home: Path, name: str, split: str, reference: pd.DataFrame | None
) -> list[dict[str, Any]]:
    """Score an entry's alarms of a split, or read the score of just these alarms beside just this reference."""
    entry = entry_folder(home, name, ground)
    alarms = read_table_in(entry, f"{split}/{ALARMS}", "alarms")
    other = None if reference is None or name == ground.table.reference else reference
    sealed = home / "lanes" / SEALED
    # Without tiers nothing is said of them, so that scores of before there were tiers are found
    # again.
    rules = ground.table.model_dump(mode="json", exclude=None if ground.table.tiers else {"tiers"})
    made_of = [rules, alarm_hash(alarms), other is not None and alarm_hash(other)]
    key = sha256(json.dumps([made_of, sha256(Folder(sealed.parent).read(sealed.name))]).encode())[
        :12
    ]
    kept = entry / split / f"score-{key}.json"
    if not Folder(entry).has(f"{split}/{kept.name}"):
        names = [lane.name for lane in ground.tested(split)]
        looked = match_blind(alarms, sealed, passphrase(ground), some=names).matched
        # The reference's own score was logged when it was scored; here it is only paired.
        beside = None if other is None else match(other, looked.truth, looked.lanes, looked.halo)
        rows = list(_rows(ground, split, looked, beside))
        write_whole(kept, json.dumps(rows) + "\n")
    about = {"entry": name, "split": split}
    return [about | row for row in Folder(entry).json(f"{split}/{kept.name}")]


def _rows(
    ground: Ground, split: str, matched: Match, reference: Match | None
) -> Iterator[dict[str, Any]]:
    """Give the score of all mines, of every kind of target, of every packaged body, and of the mines of every site."""
    kind = matched.truth["kind"].astype(str)
    mines = _mines(ground, split, kind).to_numpy()
    site = (
        matched.truth["lane"]
        .map({lane.name: lane.site for lane in ground.tested(split)})
        .to_numpy()
    )
    level = chance(matched)
    groups = {MINES: mines} | {str(one): (kind == one).to_numpy() for one in sorted(kind.unique())}
    groups |= {name: rows.to_numpy() for name, rows in _body_groups(matched.truth).items()}
    for name, rows in groups.items():
        yield from _points(ground, name, matched, level, rows, reference if name == MINES else None)
    for name in ground.sites:
        own = [lane.name for lane in ground.tested(split) if lane.site == name]
        if own and (mines & (site == name)).any():
            part = _part_of(matched, own)
            rows = _mines(ground, split, part.truth["kind"].astype(str)).to_numpy()
            yield from _points(ground, name, part, chance(part), rows, None)


def _body_groups(targets: pd.DataFrame) -> dict[str, pd.Series]:
    """Tell which targets have each packaged body; none where the truth does not name bodies."""
    if "body" not in targets.columns:
        return {}
    body = targets["body"].fillna("").astype(str)
    return {f"{BODY}{one}": body == one for one in sorted(body.unique()) if one}


def _oracle_rows(ground: Ground, found: pd.DataFrame) -> Iterator[dict[str, Any]]:
    """Give the score of both oracles in the splits whose targets they know; chance is that of strewn alarms."""
    for name, split in itertools.product(ORACLES, ground.table.splits):
        tested = {lane.name for lane in ground.tested(split) if not lane.empty}
        own = found[found["lane"].isin(tested)]
        if set(own["lane"]) != tested:
            continue
        mines = _mines(ground, split, own["kind"])
        groups = {MINES: mines} | {
            str(one): own["kind"] == one for one in sorted(own["kind"].unique())
        }
        groups |= _body_groups(own)
        groups |= {site: mines & (own["site"] == site) for site in ground.sites}
        for (group, rows), allowed in itertools.product(groups.items(), ground.table.fars):
            count = int((own.loc[rows, ORACLES[name][0]] <= allowed).sum())
            total = int(rows.sum())
            low, high = clopper_pearson(count, total)
            told = {
                "pd": count / total,
                "pd_low": low,
                "pd_high": high,
                "n_detected": count,
                "n_targets": total,
            }
            told |= {
                "chance": -math.expm1(-allowed * math.pi * ground.table.halo**2),
                "far": allowed,
            }
            area = float(own.drop_duplicates("site")["area"].sum())
            about = {"entry": name, "split": split, "group": group, "far_allowed": allowed}
            yield about | told | {"n_false": int(allowed * area), "area": area}


def _mines(ground: Ground, split: str, kind: Any) -> Any:
    """Tell which targets, by their kinds, are the mines that a split is scored on."""
    wanted = ground.table.splits[split].kinds
    return kind.isin(wanted) if wanted else kind != "simulant"


def _part_of(matched: Match, lanes: Sequence[str]) -> Match:
    """Match of some of the lanes alone."""
    alarms, truth = (
        table[table["lane"].isin(lanes)].reset_index(drop=True)
        for table in (matched.alarms, matched.truth)
    )
    return match(alarms, truth, {name: matched.lanes[name] for name in lanes}, matched.halo)


def _points(
    ground: Ground, group: str, matched: Match, level: Any, rows: Any, reference: Match | None
) -> Iterator[dict[str, Any]]:
    curve = level.add_chance_column(roc_of(matched, rows), rows)
    fars = ground.table.fars
    for allowed, (_, row) in zip(
        fars, curve.iloc[operating_row(curve, np.array(fars))].iterrows(), strict=True
    ):
        told = {name: float(row[name]) for name in ("pd", "pd_low", "pd_high", "chance", "far")}
        told |= {name: int(row[name]) for name in _COUNTS} | {"area": float(curve.attrs["area"])}
        if allowed == ground.table.far:
            told["pd_mean"] = float(pd_mean(curve, max(fars)))
            if reference is not None:
                paired = compare(
                    matched, reference, rows, far=allowed, far_max=max(fars), draws=200
                )
                told |= {
                    "only": paired.only_a,
                    "reference_only": paired.only_b,
                    "p": paired.p_detections,
                }
        yield {"group": group, "far_allowed": allowed, **told}


def _cost(ground: Ground, name: str, entry: Path) -> dict[str, Any]:
    costs = read_costs(entry)
    lanes = {lane: cost for lane, cost in costs.items() if lane in ground.lanes and cost}
    length = sum(ground.lanes[lane].length for lane in lanes) / 1000
    seconds = sum(cost["processor_seconds"] for cost in lanes.values())
    return {
        "entry": name,
        "seconds_per_km": seconds / length if length else float("nan"),
        "training_seconds": sum(
            cost["processor_seconds"] for part, cost in costs.items() if part.startswith("training")
        ),
        "peak_bytes": max((cost["peak_bytes"] for cost in lanes.values()), default=float("nan")),
    }


def of_tier(table: pd.DataFrame, ground: Ground) -> pd.DataFrame:
    """Give the rows of scores or of costs that are of a tier; all of them on a ground without tiers."""
    return table[table["tier"] == ground.tier] if ground.tier else table


def table_text(ground: Ground, scores: pd.DataFrame, costs: pd.DataFrame) -> str:
    """Write the table of all mines at the FAR of comparison, in words and figures."""
    lines = [
        f"{ground.title}: Pd of mines at {ground.table.far:g} false alarms per m², 95 % interval, "
        "chance"
    ]
    for tier in ground.chosen_tiers():
        own = of_tier(scores, tier)
        if len(own):
            lines += _tier_lines(tier, own)
    name_width = max(len(ground_tier) for ground_tier in ("", *ground.table.tiers))
    lines += ["", f"{'cost':22} {'':{name_width}} processor s/km  training s  largest process MiB"]
    for one in costs.to_dict("records"):
        figures = f"{one['seconds_per_km']:14.0f} {one['training_seconds']:11.0f} {one['peak_bytes'] / 2**20:20.0f}"
        lines.append(f"  {one['entry']:20} {one.get('tier', ''):{name_width}} {figures}")
    return "\n".join(lines)


def _tier_lines(ground: Ground, scores: pd.DataFrame) -> list[str]:
    """Write the lines of every split of a ground, or of one of its tiers."""
    lines = ["", f"TIER {ground.tier}: {ground.tier_title}"] if ground.tier else []
    chosen = scores[(scores["group"] == MINES) & (scores["far_allowed"] == ground.table.far)]
    for split, row in ground.table.splits.items():
        lines += ["", f"{split}: {row.title}"]
        ranked = chosen[chosen["split"] == split].sort_values("pd", ascending=False, kind="stable")
        for one in ranked.to_dict("records"):
            start = f"  {one['entry']:20} {pd_in_words(one)}"
            lines.append(start + paired_in_words(one, f"; against {ground.table.reference} "))
    return lines


def pd_in_words(one: Mapping[Any, Any]) -> str:
    """Say a Pd with its interval, counts and chance."""
    return (
        f"{one['pd']:.2f} ({one['pd_low']:.2f} to {one['pd_high']:.2f}), {one['n_detected']:.0f} "
        "of "
        f"{one['n_targets']:.0f}, {one['n_false']:.0f} false, chance {one['chance']:.2f}"
    )


def paired_in_words(one: Mapping[Any, Any], before: str = "") -> str:
    """Say how it stands against the reference, mine by mine; nothing of the reference itself."""
    p = one.get("p")
    if p is None or not np.isfinite(p):
        return ""
    return f"{before}+{one['only']:.0f} -{one['reference_only']:.0f}, p = {p:.2g}"


def write_table(folders: Sequence[str | Path], output: str | Path) -> str:
    """Score what is not scored yet, write ``scores.csv``, ``costs.csv`` and ``index.html``, and give the table as text.

    The first file is the same, to the digit, for the same alarms; the second is what this machine
    took.
    """
    homes = [Path(folder) for folder in folders]
    to = Path(output)
    scores, costs = score_entries(homes)
    ground = _ground_of(homes)
    to.mkdir(parents=True, exist_ok=True)
    write_whole(to / "scores.csv", scores.to_csv(index=False, float_format="%.6g"))
    write_whole(to / "costs.csv", costs.to_csv(index=False, float_format="%.4g"))
    titles, faults = _titles_and_faults(ground, homes)
    titles |= {name: title for name, (_, title) in ORACLES.items() if name in set(scores["entry"])}
    page = _page(ground, scores, costs, titles)
    if (to / "index.html").is_file() and read_named(to / "index.html").decode(
        "utf-8", "replace"
    ) == page:
        tell_finished(to / "index.html")
    write_whole(to / "index.html", page)
    return "\n".join([table_text(ground, scores, costs), *faults])


def _titles_and_faults(ground: Ground, homes: Sequence[Path]) -> tuple[dict[str, str], list[str]]:
    """Tell by name what entries are, with what kept them from finishing, and list the latter in lines of their own."""
    titles: dict[str, str] = {}
    faults = []
    for tier in ground.chosen_tiers():
        where = f" on the tier {tier.tier}" if tier.tier else ""
        for home, name in _entries(homes, tier):
            about = Folder(entry_folder(home, name, tier)).json(ABOUT)
            titles.setdefault(name, about["title"])
            if about["fault"]:
                titles[name] += f"; did not finish{where}: {about['fault']}"
                faults.append(f"{name} did not finish{where}: {about['fault']}")
    return titles, faults


def _page(
    ground: Ground, scores: pd.DataFrame, costs: pd.DataFrame, titles: Mapping[str, str]
) -> str:
    tiers = [tier for tier in ground.chosen_tiers() if len(of_tier(scores, tier))]
    return render(
        "benchmark.html",
        ground=ground,
        opening=_opening(ground, scores),
        opening_split=opening_split(ground),
        tiers=[(tier, list(_page_splits(tier, of_tier(scores, tier)))) for tier in tiers],
        heads=["entry", *(f"Pd at {far:g} per m²" for far in ground.table.fars), f"against {ground.table.reference}"],
        titles=titles,
        cost_heads=[
            "entry", *(["tier"] if ground.table.tiers else []),
            ">processor seconds per km", ">training, s", ">largest process, MiB",
        ],
        costs=[_cost_cells(one) for one in costs.to_dict("records")],
    )  # fmt: skip


def _opening(ground: Ground, scores: pd.DataFrame) -> dict[str, Figure]:
    """Draw the figure that opens the page of a ground with tiers, for wide screens and paper and for narrow screens."""
    if not ground.table.tiers:
        return {}
    return {
        "wide": tiers_figure(ground, scores),
        "narrow": tiers_figure(ground, scores, narrow=True),
    }


def _cost_cells(one: Mapping[Any, Any]) -> list[str]:
    """Write a row of the table of costs."""
    names = [one["entry"], one["tier"]] if "tier" in one else [one["entry"]]
    figures = [f"{one[name]:.0f}" for name in ("seconds_per_km", "training_seconds")]
    return [*names, *figures, f"{one['peak_bytes'] / 2**20:.0f}"]


def _page_splits(
    ground: Ground, scores: pd.DataFrame
) -> Iterator[tuple[str, str, Figure, list[tuple[str, ...]]]]:
    """Give name, title, figure and rows of the table of every split that was run."""
    for split, row in ground.table.splits.items():
        if (scores["split"] == split).any():
            yield (
                split,
                row.title,
                split_figure(ground, scores, split),
                list(_page_rows(ground, scores, split)),
            )


def _page_rows(ground: Ground, scores: pd.DataFrame, split: str) -> Iterator[tuple[str, ...]]:
    mine = scores[(scores["split"] == split) & (scores["group"] == MINES)]
    order = mine[mine["far_allowed"] == ground.table.far].sort_values(
        "pd", ascending=False, kind="stable"
    )["entry"]
    mine = mine.set_index("entry", drop=False).loc[list(order)].rename_axis(None)
    for entry, rows in mine.groupby("entry", sort=False):
        at = {row["far_allowed"]: row for row in rows.to_dict("records")}
        paired = (
            "reference"
            if entry == ground.table.reference
            else paired_in_words(at[ground.table.far])
        )
        yield (str(entry), *(pd_in_words(at[far]) for far in ground.table.fars), paired)


def listing(
    quick: bool = False, lanes: str | Path | None = None, ground: str | Path | None = None
) -> list[str]:
    """Tell in lines what enters, which lanes there are and how they are split; with a folder whether they are alike.

    Lanes are the same bits, alike (the rms of the echoes of every polarization within 1e-4), or
    other lanes than those whose fingerprints come with the package.
    """
    chosen = load_ground(quick, None if ground is None else Path(ground))
    lines = [f"{chosen.title}, seen by {chosen.table.sensor}", "", "entries:"]
    lines += [f"  {name:20} {entry.title}" for name, entry in packaged_entries(chosen).items()]
    if chosen.table.tiers:
        lines += ["", "tiers, each with all splits:"]
        lines += [
            f"  {name:20} {row.title}, at {', '.join(row.sites.values())}"
            for name, row in chosen.table.tiers.items()
        ]
    lines += [
        "",
        "splits:",
        *(f"  {name:20} {row.title}" for name, row in chosen.table.splits.items()),
        "",
        "lanes:",
    ]
    told = same_lanes(chosen, Path(lanes)) if lanes is not None else {}
    width = max(20, *(len(name) for name in chosen.lanes))
    for name, lane in chosen.lanes.items():
        line = f"  {name:{width}} {lane.part:9} {lane.length:5g} m {len(lane.truth()):3} targets"
        lines.append(f"{line}  {told[name]}" if told else line)
    return lines


def same_lanes(ground: Ground, home: Path) -> dict[str, str]:
    """Compare lanes with the packaged fingerprints: "same bits", "alike", "other", "not there", "not known"."""
    ours = resources.files("flgpr.proving_ground") / "fingerprints.csv"
    known = pd.read_csv(io.StringIO(ours.read_text("utf-8"))).set_index("lane")
    existing(home / PRINTS, "fingerprints of lanes")
    found = parse_columns(Folder(home).read(PRINTS)).set_index("lane")

    def compared(name: str) -> str:
        key = f"{ground.title} {name}"
        if name not in found.index or key not in known.index:
            return "not there" if key in known.index else "not known"
        one = found.loc[name]
        other = known.loc[key]
        if one["sha256"] == other["sha256"]:
            return "same bits"
        levels = [column for column in found.columns if column != "sha256"]
        near = np.allclose(
            one[levels].astype(float), other[levels].astype(float), rtol=1e-4, atol=0
        )
        return "alike" if near else "other"

    return {name: compared(name) for name in ground.lanes}
