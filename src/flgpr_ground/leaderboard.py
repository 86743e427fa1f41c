"""The leaderboard: submissions beside the packaged entries, as a page that is made from files."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from flgpr.door import read_named
from flgpr.report import render
from flgpr.store import write_whole
from flgpr.store.outputs import log_finished
from flgpr_ground.board import (
    SUBMITTED,
    Board,
    Row,
    ranked_rows,
    read_board,
    scores_at,
)
from flgpr_ground.citing import DATA_LICENCE, cite_ground, cite_submission
from flgpr_ground.entries import ORACLES, packaged_entries
from flgpr_ground.figures import leaderboard_figure, opening_split
from flgpr_ground.ground import Ground
from flgpr_ground.table import paired_in_words

_KINDS = ("metal", "plastic", "ap")
_MARK = b'<meta name="generator" content="flgpr leaderboard">'
"""In the template: by which an older page is known, which a newer one replaces."""
_HEAD = 2000  # bytes of a page in which the mark stands


def write_leaderboard(folders: Sequence[str | Path], output: str | Path) -> Path:
    """Write the leaderboard of folders in which submissions were entered or detectors ran.

    Parameters
    ----------
    folders : sequence of str or path
        Folders of ``flgpr benchmark enter`` or ``run``, of one ground.
    output : str or path
        HTML file to write.

    Returns
    -------
    Path
        The file.

    Raises
    ------
    FileExistsError
        If the file is there and is no leaderboard.
    ValueError
        If a folder is no such, its tables or cards break a rule, or they are of different grounds.
    """
    board = read_board([Path(folder) for folder in folders])
    path = Path(output)
    page = leaderboard_html(board)
    refuse_other_page(path)
    if path.exists() and read_named(path) == page.encode():
        log_finished(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    write_whole(path, page)
    return path


def refuse_other_page(path: Path) -> None:
    """Refuse an output that is there and is no leaderboard.

    Parameters
    ----------
    path : Path
        The output.

    Raises
    ------
    FileExistsError
        If another file is there.
    """
    if path.exists() and _MARK not in read_named(path)[:_HEAD]:
        raise FileExistsError(
            f"output must not exist yet or be an older leaderboard, got {path}, which holds "
            "something else"
        )


def leaderboard_html(board: Board) -> str:
    """Return the page of a board, HTML text without references to other files."""
    ground = board.ground
    split = opening_split(ground)
    tiers = []
    figures = []
    for tier in ground.chosen_tiers():
        rows = ranked_rows(board, tier.tier, split)
        if not rows:
            continue
        figures.append((tier, rows))
        heads = _heads_of(board, tier, split, rows)
        table = _table_of(board, tier, split, rows)
        tiers.append((tier, heads, table, _other_splits(board, tier)))
    shown = set(board.scores["entry"])
    titles = []
    for name, entry in packaged_entries(ground).items():
        titles.append((name, entry.title))
    for name, (_, title) in ORACLES.items():
        titles.append((name, title))
    return render(
        "leaderboard.html",
        package="flgpr_ground",
        ground=ground,
        split=split,
        split_title=ground.table.splits[split].title,
        wide=leaderboard_figure(figures, board.cards),
        narrow=leaderboard_figure(figures, board.cards, narrow=True),
        tiers=tiers,
        headline=_headline(board, split),
        cards=[_card_rows(board, name) for name in sorted(board.cards)],
        others=[(name, title) for name, title in titles if name in shown],
        not_ranked=[(name, reason) for name, reason in board.not_ranked.items() if name in shown],
        looks=board.looks,
        lists=board.lists,
        citation=cite_ground(ground),
        licence=DATA_LICENCE,
    )


def _headline(board: Board, split: str) -> list[str]:
    """Return a sentence per tier: who is in front, and who is not told apart from it."""
    sentences = []
    for tier in board.ground.chosen_tiers():
        rows = [row for row in ranked_rows(board, tier.tier, split) if row.first]
        if not rows:
            continue
        best = rows[0]
        on_tier = f"On {tier.tier_title}" if tier.tier_title else "Here"
        mines = f"{best.score['n_detected']:.0f} of {best.score['n_targets']:.0f} mines"
        unclear = len(best.unclear)
        if not unclear:
            sentences.append(f"{on_tier} {best.entry} is first and finds {mines}.")
            continue
        near_entries = "another entry" if unclear == 1 else f"{unclear} other entries"
        sentences.append(
            f"{on_tier} {best.entry} finds most, {mines}; it is not told apart from {near_entries}."
        )
    return sentences


@dataclass(frozen=True)
class TableRow:
    """A row of the table of a tier, as text."""

    rank: str
    entry: str
    submitted: bool
    source: str
    pd: str
    found: str
    kinds: tuple[str, ...]  #: found of every kind
    chance: str
    paired: str
    cost: str
    unclear: str


def _heads_of(board: Board, tier: Ground, split: str, rows: Sequence[Row]) -> list[str]:
    """Return the titles of the columns of counts, with the numbers of targets."""
    heads = [f"mines of {rows[0].score['n_targets']:.0f}"]
    for kind in _KINDS:
        table = scores_at(board, tier.tier, split, board.ground.table.far, kind)
        title = "AP" if kind == "ap" else kind
        heads.append(title if table.empty else f"{title} of {table['n_targets'].max():.0f}")
    return heads


def _table_of(board: Board, tier: Ground, split: str, rows: Sequence[Row]) -> list[TableRow]:
    """Return the rows of the table of a tier."""
    by_kind = {}
    for kind in _KINDS:
        table = scores_at(board, tier.tier, split, board.ground.table.far, kind)
        by_kind[kind] = table.set_index("entry")
    table_rows = []
    for row in rows:
        score = row.score
        cells = []
        for kind in _KINDS:
            detected = by_kind[kind]["n_detected"]
            cells.append(f"{detected[row.entry]:.0f}" if row.entry in detected.index else "")
        paired = paired_in_words(score)
        if row.entry == board.ground.table.reference:
            paired = "reference"
        table_rows.append(
            TableRow(
                rank=row.rank,
                entry=row.entry,
                submitted=row.source == SUBMITTED,
                source=row.source,
                pd=f"{score['pd']:.2f} ({score['pd_low']:.2f} to {score['pd_high']:.2f})",
                found=f"{score['n_detected']:.0f}",
                kinds=tuple(cells),
                chance=f"{score['chance']:.2f}",
                paired=paired,
                cost=_cost_text(board, tier.tier, row.entry),
                unclear=_unclear_text(row),
            )
        )
    return table_rows


def _unclear_text(row: Row) -> str:
    """Return which entry, or how many, a row is not told apart from."""
    if not row.first:
        return ""
    count = len(row.unclear)
    if not count:
        return "none"
    return row.unclear[0] if count == 1 else f"{count} others"


def _cost_text(board: Board, tier: str, entry: str) -> str:
    """Return seconds per km of an entry, as measured, or declared on its card."""
    seconds = board.costs.get((tier, entry), {}).get("seconds_per_km", math.nan)
    if not math.isfinite(seconds):
        return "not known"
    return f"{seconds:.0f}"


def _other_splits(board: Board, tier: Ground) -> tuple[list[str], list[tuple[str, ...]]]:
    """Return heads and rows of Pd in all splits, at the FAR of comparison."""
    splits = list(board.ground.table.splits)
    columns = {}
    names: dict[str, None] = {}  # in the order of the first split that has them
    for split in splits:
        scores = scores_at(board, tier.tier, split, board.ground.table.far)
        by_entry = scores.set_index("entry")
        columns[split] = by_entry
        order = by_entry.sort_values("pd", ascending=False, kind="stable")
        names |= dict.fromkeys(map(str, order.index))
    rows = []
    for name in names:
        cells = [name]
        for split in splits:
            cells.append(_interval_of(columns[split], name))
        rows.append(tuple(cells))
    return ["entry", *splits], rows


def _interval_of(scores: pd.DataFrame, name: str) -> str:
    """Return Pd and interval of an entry, empty if it has none."""
    if name not in scores.index:
        return ""
    score = scores.loc[name]
    return f"{score['pd']:.2f} ({score['pd_low']:.2f} to {score['pd_high']:.2f})"


def _card_rows(board: Board, name: str) -> tuple[str, str, list[tuple[str, str]]]:
    """Return name, method and all entries of a card as text."""
    card = board.cards[name]
    record = board.records[name]
    rows = [
        ("authors", ", ".join(card.authors)),
        ("version", card.version),
        ("date", card.date.isoformat()),
        ("licence", card.licence),
        ("trained on", card.trained_on),
        ("test lanes seen", "yes" if card.test_lanes_seen else "no"),
        ("test truth seen", "yes" if card.test_truth_seen else "no"),
        ("hardware", card.cost.hardware),
        ("seconds per km", f"{card.cost.seconds_per_km:g}"),
    ]
    if card.cost.training_seconds is not None:
        rows.append(("training, s", f"{card.cost.training_seconds:g}"))
    if card.cost.peak_mib is not None:
        rows.append(("largest process, MiB", f"{card.cost.peak_mib:g}"))
    for title, text in (
        ("digest", card.digest),
        ("reference", card.reference),
        ("contact", card.contact),
    ):
        if text:
            rows.append((title, text))
    if card.parameters:
        rows.append(("parameters", json.dumps(card.parameters, ensure_ascii=False)))
    lanes = record.get("lanes", {})
    if isinstance(lanes, dict):
        counts = [f"{count} {word}" for word, count in lanes.items()]
        rows.append(("lanes, beside the authors'", ", ".join(map(str, counts))))
    alarms = record.get("alarms", {})
    if isinstance(alarms, dict):
        for key, digest in alarms.items():
            rows.append((f"SHA-256 of the alarms, {key}", str(digest)))
    rows.append(("cite as", cite_submission(card)))
    return name, card.method, rows
