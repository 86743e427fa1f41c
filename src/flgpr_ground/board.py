"""What a leaderboard is made of: tables of scores, cards and logs, and the ranks they allow.

Nothing is opened that is sealed and no detector runs. The scores of the packaged entries come with
the package. Folders may come from anyone; their files are opened by :mod:`flgpr.door`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from flgpr.door import Folder
from flgpr.scoring import clopper_pearson
from flgpr.store.tables import parse_columns
from flgpr.types import BoolArray
from flgpr_ground.card import CARD, RECORD, Card, entered_card, parse_card
from flgpr_ground.citing import is_packaged
from flgpr_ground.entries import ORACLES
from flgpr_ground.ground import MINES, Ground
from flgpr_ground.running import SEALED, common_ground
from flgpr_trials.ledger import read_register

SCORES = "scores.csv"
COSTS = "costs.csv"
SUBMITTED = "submission"
PACKAGED = "packaged"
RUN_HERE = "run here"
_MOST_ENTRIES = 500
_MOST_TABLE_BYTES = 64 * 2**20
_KEYS = ("tier", "entry", "split", "group", "far_allowed")
_COUNTS = ("n_detected", "n_targets", "n_false", "area", "chance")
_INTEGERS = ("n_detected", "n_targets", "n_false")
_LARGEST_COUNT = 1e9
_PAIRED = ("only", "reference_only", "p")


@dataclass(frozen=True)
class Row:
    """An entry in the table of a tier and a split."""

    entry: str
    source: str  #: where it comes from: SUBMITTED, PACKAGED or RUN_HERE
    score: Mapping[Any, Any]  #: its row of the scores: all mines at the FAR of comparison
    first: int = 0  #: best rank that it can have; 0 if it is not ranked
    last: int = 0  #: worst rank that it can have
    unclear: tuple[str, ...] = ()  #: ranked entries that it is not told apart from

    @property
    def rank(self) -> str:
        """The rank in words."""
        if not self.first:
            return "not ranked"
        return str(self.first) if self.first == self.last else f"{self.first} to {self.last}"


@dataclass
class Board:
    """What the page shows of one ground."""

    ground: Ground
    scores: pd.DataFrame  #: a row per tier, entry, split, group and allowed FAR
    costs: dict[tuple[str, str], dict[str, float]]  #: by tier and entry
    sources: dict[str, str]  #: by entry: SUBMITTED, PACKAGED or RUN_HERE
    cards: dict[str, Card] = field(default_factory=dict)
    records: dict[str, Mapping[str, Any]] = field(default_factory=dict)
    looks: int = 0  #: entries in the logs of the folders
    lists: int = 0  #: different alarm lists among them

    @property
    def not_ranked(self) -> dict[str, str]:
        """Entries that are shown without a rank, with the reason."""
        reasons = {}
        for name, card in self.cards.items():
            if card.why_not_ranked:
                reasons[name] = card.why_not_ranked
        for name, (_, title) in ORACLES.items():
            reasons[name] = f"no detector: {title}"
        return reasons

    def seconds_per_km(self, tier: str, entry: str) -> float | None:
        """Return what an entry takes, as measured or as declared on its card; None if unknown."""
        seconds = self.costs.get((tier, entry), {}).get("seconds_per_km", math.nan)
        return seconds if math.isfinite(seconds) else None


def read_board(folders: Sequence[Path]) -> Board:
    """Read the tables, cards and logs of folders.

    Parameters
    ----------
    folders : sequence of path
        Folders of ``flgpr benchmark enter`` or ``run``, of one ground.

    Returns
    -------
    Board
        The scores of all of them, and of the packaged entries.

    Raises
    ------
    ValueError
        If there is no folder, they are of different grounds, hold no scores, or a table or card
        breaks a rule.
    """
    if not folders:
        raise ValueError("folders must be one or more, got none")
    board = packaged_board(common_ground(folders))
    for folder in folders:
        _add_folder(board, folder)
    if board.scores.empty:
        names = ", ".join(map(str, folders))
        raise ValueError(
            f"folders must hold scores, got none in {names}: "
            "`flgpr benchmark enter` and `run` write them"
        )
    return board


def packaged_board(ground: Ground) -> Board:
    """Return the scores of the packaged entries that come with the package.

    They are those of the authors' full run.

    Parameters
    ----------
    ground : Ground
        The ground.

    Returns
    -------
    Board
        The scores; empty for another ground, or the quick form.
    """
    package = resources.files("flgpr_ground")
    scores_file = package / f"scores-{ground.title}.csv"
    costs_file = package / f"costs-{ground.title}.csv"
    if not is_packaged(ground) or not scores_file.is_file():
        no_scores = pd.DataFrame(columns=[*_KEYS, *_COUNTS, *_PAIRED])
        return Board(ground, no_scores, {}, {})
    scores = _checked_scores(scores_file.read_bytes(), ground, scores_file.name)
    costs = _checked_costs(costs_file.read_bytes())
    sources = dict.fromkeys(scores["entry"], PACKAGED)
    return Board(ground, scores, costs, sources)


def _add_folder(board: Board, folder: Path) -> None:
    """Add what a folder holds; its entries replace packaged ones of the same name."""
    files = Folder(folder)
    if files.has(SCORES):
        table = files.read(SCORES, _MOST_TABLE_BYTES)
        scores = _checked_scores(table, board.ground, SCORES)
        names = set(scores["entry"])
        _check_names(board, names)
        earlier = board.scores[~board.scores["entry"].isin(names)]
        if earlier.empty:
            board.scores = scores
        else:
            board.scores = pd.concat([earlier, scores], ignore_index=True)
        board.sources |= dict.fromkeys(names, RUN_HERE)
        for tier, name in list(board.costs):
            if name in names:
                del board.costs[tier, name]
        if files.has(COSTS):
            board.costs |= _checked_costs(files.read(COSTS, _MOST_TABLE_BYTES))
        for name in sorted(names):
            _add_card(board, files, name)
    _count_looks(board, folder)


def _check_names(board: Board, names: set[str]) -> None:
    """Refuse entries whose names another folder has used; oracles are in every folder."""
    claimed = {name for name in names if board.sources.get(name, PACKAGED) != PACKAGED}
    if claimed - set(ORACLES):
        raise ValueError(
            f"folders must have entries of different names, got {sorted(claimed)[0]} twice"
        )


def _add_card(board: Board, files: Folder, name: str) -> None:
    """Add the card of an entry that is a submission."""
    card_name = f"entries/{name}/{CARD}"
    card_text = entered_card(files, name)
    if card_text is None:
        return
    card, faults = parse_card(card_text)
    if card is None or card.name != name or card.ground != board.ground.title:
        fault = faults[0] if faults else "it must be of this entry and this ground"
        raise ValueError(f"{files.root / card_name}: {fault}")
    board.cards[name] = card
    board.records[name] = files.json(f"entries/{name}/{RECORD}")
    board.sources[name] = SUBMITTED
    for tier in board.ground.chosen_tiers():
        board.costs[tier.tier, name] = card.cost.declared()


def _count_looks(board: Board, folder: Path) -> None:
    """Count the looks at the sealed truth of a folder."""
    log = folder / "lanes" / f"{SEALED}.log.jsonl"
    if not log.is_file():
        return
    looks = [line for line in read_register(log) if line.get("event") in ("score", "open")]
    board.looks += len(looks)
    board.lists += len({line["alarms"] for line in looks if "alarms" in line})


def _checked_scores(data: bytes, ground: Ground, name: str) -> pd.DataFrame:
    """Return a table of scores with what the page needs; Pd and interval come from the counts."""
    table = parse_columns(data, "tier", "entry", "split", "group")
    if not ground.table.tiers:
        table = table.assign(tier="")
    missing = [column for column in (*_KEYS, *_COUNTS) if column not in table.columns]
    if missing:
        raise ValueError(f"{name} must have the columns {', '.join(missing)}")
    for column in _PAIRED:
        if column not in table.columns:
            table[column] = np.nan
    chosen = table[[*_KEYS, *_COUNTS, *_PAIRED]].copy()
    for column in ("far_allowed", *_COUNTS, *_PAIRED):
        chosen[column] = pd.to_numeric(chosen[column], errors="coerce")

    is_usable = _is_of_ground(chosen, ground) & _has_counts(chosen)
    if not is_usable.all():
        faulty = int((~is_usable).sum())
        raise ValueError(
            f"{name} must have counts of targets of splits and tiers of {ground.title} in every "
            f"row, got {faulty} rows without"
        )
    if chosen["entry"].nunique() > _MOST_ENTRIES:
        raise ValueError(f"{name} must have at most {_MOST_ENTRIES} entries, got more")
    if chosen.duplicated(list(_KEYS)).any():
        raise ValueError(f"{name} must have one row per entry, split, group and FAR, got more")

    points = []
    for detected, targets in zip(chosen["n_detected"], chosen["n_targets"], strict=True):
        low, high = clopper_pearson(int(detected), int(targets))
        points.append((detected / targets, float(low), float(high)))
    chosen[["pd", "pd_low", "pd_high"]] = np.array(points).reshape(-1, 3)
    return chosen


def _is_of_ground(scores: pd.DataFrame, ground: Ground) -> BoolArray:
    """Return which rows are of a split and a tier of the ground, and name entry and group."""
    tiers = list(ground.table.tiers) or [""]
    is_known = scores["split"].isin(list(ground.table.splits))
    is_known &= scores["tier"].isin(tiers)
    is_known &= scores["entry"].notna() & scores["group"].notna()
    return np.asarray(is_known, dtype=np.bool_)


def _has_counts(scores: pd.DataFrame) -> BoolArray:
    """Return which rows hold possible counts: none negative, and no more found than there are."""
    has_counts = np.ones(len(scores), dtype=np.bool_)
    for column in _COUNTS:
        values = scores[column].to_numpy(float)
        has_counts &= np.isfinite(values) & (values >= 0) & (values <= _LARGEST_COUNT)
        if column in _INTEGERS:
            has_counts &= values == np.floor(values)
    has_counts &= (scores["n_detected"] <= scores["n_targets"]).to_numpy()
    has_counts &= (scores["n_targets"] >= 1).to_numpy()
    return has_counts


def _checked_costs(data: bytes) -> dict[tuple[str, str], dict[str, float]]:
    """Return the costs of entries by tier and name; NaN where they are not known."""
    table = parse_columns(data, "tier", "entry")
    if "tier" not in table.columns:
        table = table.assign(tier="")
    costs = {}
    for row in table.to_dict("records"):
        seconds = {}
        for name in ("seconds_per_km", "training_seconds"):
            value = pd.to_numeric(row.get(name, math.nan), errors="coerce")
            seconds[name] = float(value)
        costs[str(row["tier"]), str(row["entry"])] = seconds
    return costs


def ranked_rows(board: Board, tier: str, split: str) -> list[Row]:
    """Return the entries of a tier and a split, the largest Pd first, those without a rank last.

    An entry is ahead of another if its interval lies above the other's as a whole. Where intervals
    overlap the two are not told apart: an entry then has a range of ranks, from one more than the
    number of entries ahead of it to the number of those that it is not ahead of.

    Parameters
    ----------
    board : Board
        All scores.
    tier : str
        The tier, empty on a ground without tiers.
    split : str
        The split.

    Returns
    -------
    list of Row
        A row per entry.
    """
    scores = scores_at(board, tier, split, board.ground.table.far)
    ordered = scores.sort_values(["pd", "entry"], ascending=[False, True], kind="stable")
    not_ranked = board.not_ranked
    is_ranked = ~ordered["entry"].isin(list(not_ranked))
    ranked = ordered[is_ranked]
    low = ranked["pd_low"].to_numpy()
    high = ranked["pd_high"].to_numpy()
    rows = []
    rows_without_rank = []
    for score in ordered.to_dict("records"):
        name = str(score["entry"])
        source = board.sources.get(name, RUN_HERE)
        if name in not_ranked:
            rows_without_rank.append(Row(name, source, score))
            continue
        ahead = low > score["pd_high"]
        behind = high < score["pd_low"]
        unclear = ranked["entry"][~ahead & ~behind]
        rows.append(
            Row(
                name,
                source,
                score,
                first=1 + int(ahead.sum()),
                last=len(ranked) - int(behind.sum()),
                unclear=tuple(str(other) for other in unclear if other != name),
            )
        )
    return rows + rows_without_rank


def scores_at(board: Board, tier: str, split: str, far: float, group: str = MINES) -> pd.DataFrame:
    """Return the scores of a group of targets in a tier and a split at an allowed FAR.

    Parameters
    ----------
    board : Board
        All scores.
    tier : str
        The tier, empty on a ground without tiers.
    split : str
        The split.
    far : float
        The allowed FAR, per m².
    group : str
        The group: all mines by default, a site, a kind or a body.

    Returns
    -------
    pandas.DataFrame
        A row per entry.
    """
    scores = board.scores
    is_chosen = (scores["tier"] == tier) & (scores["split"] == split)
    is_chosen &= scores["group"] == group
    # A FAR that was written to a table and read again may differ in its last digit.
    is_chosen &= np.isclose(scores["far_allowed"].astype(float), far)
    return scores[is_chosen]
