"""What a leaderboard is made of: tables of scores, cards and logs, and the ranks they allow.

Nothing is opened that is sealed and no detector runs. The scores of the packaged entries come with
the package. Folders may come from anyone; their files are opened by :mod:`flgpr.door`.
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from importlib import resources
from pathlib import Path

import pandas as pd

from flgpr.door import Folder, read_named
from flgpr.report import render
from flgpr.scoring import clopper_pearson
from flgpr.store.tables import parse_columns
from flgpr.types import Entries
from flgpr_ground.card import CARD, RECORD, Card, entered_card, parse_card
from flgpr_ground.citing import DATA_LICENCE, cite_ground, cite_submission, is_packaged
from flgpr_ground.entries import ORACLES, packaged_entries
from flgpr_ground.figures import leaderboard_figure
from flgpr_ground.ground import Ground, Score, by_pd, opening_split, scores_at
from flgpr_ground.lanes import SEALED, common_ground
from flgpr_ground.table import beside_reference, paired_in_words, write_page
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
_LARGEST_COUNT = 1e9
_PAIRED = ("only", "reference_only", "p")


@dataclass(frozen=True)
class Row:
    """An entry in the table of a tier and a split."""

    entry: str
    source: str  #: where it comes from: SUBMITTED, PACKAGED or RUN_HERE
    score: Score  #: its row of the scores: all mines at the FAR of comparison
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
    costs: dict[tuple[str, str], float]  #: seconds per km by tier and entry; NaN if unknown
    sources: dict[str, str]  #: by entry: SUBMITTED, PACKAGED or RUN_HERE
    cards: dict[str, Card] = field(default_factory=dict)
    records: dict[str, Entries] = field(default_factory=dict)
    looks: int = 0  #: entries in the logs of the folders
    lists: int = 0  #: different alarm lists among them

    @property
    def not_ranked(self) -> dict[str, str]:
        """Entries that are shown without a rank, with the reason."""
        reasons = {name: card.why_not_ranked for name, card in self.cards.items()}
        reasons |= {name: f"no detector: {title}" for name, (_, title) in ORACLES.items()}
        return {name: reason for name, reason in reasons.items() if reason}

    def seconds_per_km(self, tier: str, entry: str) -> float | None:
        """Return what an entry takes, as measured or as declared on its card; None if unknown."""
        seconds = self.costs.get((tier, entry), math.nan)
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
        return Board(ground, pd.DataFrame(columns=[*_KEYS, *_COUNTS, *_PAIRED]), {}, {})
    scores = _checked_scores(scores_file.read_bytes(), ground, scores_file.name)
    sources = dict.fromkeys(scores["entry"], PACKAGED)
    return Board(ground, scores, _checked_costs(costs_file.read_bytes()), sources)


def _add_folder(board: Board, folder: Path) -> None:
    """Add what a folder holds; its entries replace packaged ones of the same name."""
    files = Folder(folder)
    if files.has(SCORES):
        table = files.read(SCORES, _MOST_TABLE_BYTES)
        scores = _checked_scores(table, board.ground, SCORES)
        names = set(scores["entry"])
        claimed = [name for name, source in board.sources.items() if source != PACKAGED]
        repeated = sorted(names & set(claimed) - set(ORACLES))  # oracles are in every folder
        if repeated:
            raise ValueError(
                f"folders must have entries of different names, got {repeated[0]} twice"
            )
        earlier = board.scores[~board.scores["entry"].isin(names)]
        tables = [scores] if earlier.empty else [earlier, scores]
        board.scores = pd.concat(tables, ignore_index=True)
        board.sources |= dict.fromkeys(names, RUN_HERE)
        board.costs = {key: cost for key, cost in board.costs.items() if key[1] not in names}
        if files.has(COSTS):
            board.costs |= _checked_costs(files.read(COSTS, _MOST_TABLE_BYTES))
        for name in sorted(names):
            _add_card(board, files, name)
    log = folder / "lanes" / f"{SEALED}.log.jsonl"
    if log.is_file():
        looks = [line for line in read_register(log) if line.get("event") in ("score", "open")]
        board.looks += len(looks)
        board.lists += len({line["alarms"] for line in looks if "alarms" in line})


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
        board.costs[tier.tier, name] = card.cost.seconds_per_km


def _checked_scores(data: bytes, ground: Ground, name: str) -> pd.DataFrame:
    """Return a table of scores with what the page needs; Pd and interval come from the counts."""
    table = parse_columns(data, "tier", "entry", "split", "group")
    if not ground.table.tiers:
        table = table.assign(tier="")
    missing = [column for column in (*_KEYS, *_COUNTS) if column not in table.columns]
    if missing:
        raise ValueError(f"{name} must have the columns {', '.join(missing)}")
    chosen = table.reindex(columns=[*_KEYS, *_COUNTS, *_PAIRED])
    for column in ("far_allowed", *_COUNTS, *_PAIRED):
        chosen[column] = pd.to_numeric(chosen[column], errors="coerce")

    counts = chosen[list(_COUNTS)]
    whole = counts[["n_detected", "n_targets", "n_false"]]
    is_usable = chosen["split"].isin(list(ground.table.splits))
    is_usable &= chosen["tier"].isin(list(ground.table.tiers) or [""])
    is_usable &= chosen[["entry", "group"]].notna().all(axis=1)
    is_usable &= ((counts >= 0) & (counts <= _LARGEST_COUNT)).all(axis=1)
    is_usable &= (whole % 1 == 0).all(axis=1)
    is_usable &= (counts["n_targets"] >= 1) & (counts["n_detected"] <= counts["n_targets"])
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

    detected, targets = chosen["n_detected"], chosen["n_targets"]
    chosen["pd"] = detected / targets
    chosen["pd_low"], chosen["pd_high"] = clopper_pearson(detected, targets)
    return chosen


def _checked_costs(data: bytes) -> dict[tuple[str, str], float]:
    """Return the seconds per km of entries by tier and name; NaN where they are not known."""
    table = parse_columns(data, "tier", "entry")
    if "tier" not in table.columns:
        table = table.assign(tier="")
    seconds = pd.to_numeric(table.reindex(columns=["seconds_per_km"])["seconds_per_km"], "coerce")
    return dict(zip(zip(table["tier"], table["entry"], strict=True), seconds, strict=True))


def ranked_rows(board: Board, tier: Ground, split: str) -> list[Row]:
    """Return the entries of a tier and a split, the largest Pd first, those without a rank last.

    An entry is ahead of another if its interval lies above the other's as a whole. Where intervals
    overlap the two are not told apart: an entry then has a range of ranks, from one more than the
    number of entries ahead of it to the number of those that it is not ahead of.

    Parameters
    ----------
    board : Board
        All scores.
    tier : Ground
        The tier, or a ground without tiers.
    split : str
        The split.

    Returns
    -------
    list of Row
        A row per entry.
    """
    scores = scores_at(board.scores, tier, split)
    ordered = scores.sort_values(["pd", "entry"], ascending=[False, True], kind="stable")
    not_ranked = board.not_ranked
    ranked = ordered[~ordered["entry"].isin(list(not_ranked))]
    rows = []
    rows_without_rank = []
    for score in ordered.to_dict("records"):
        name = str(score["entry"])
        source = board.sources.get(name, RUN_HERE)
        if name in not_ranked:
            rows_without_rank.append(Row(name, source, score))
            continue
        ahead = ranked["pd_low"] > score["pd_high"]
        behind = ranked["pd_high"] < score["pd_low"]
        unclear = ranked["entry"][~ahead & ~behind]
        first, last = 1 + int(ahead.sum()), len(ranked) - int(behind.sum())
        others = tuple(str(other) for other in unclear if other != name)
        rows.append(Row(name, source, score, first, last, others))
    return rows + rows_without_rank


_KINDS = ("metal", "plastic", "ap")  # with a column of their own
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
    path.parent.mkdir(parents=True, exist_ok=True)
    write_page(path, page)
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
    for tier in ground.chosen_tiers():
        rows = ranked_rows(board, tier, split)
        if not rows:
            continue
        by_kind = {kind: _by_entry(scores_at(board.scores, tier, split, kind)) for kind in _KINDS}
        by_split = {
            name: _by_entry(scores_at(board.scores, tier, name)) for name in ground.table.splits
        }
        tiers.append((tier, rows, by_kind, by_split))
    figures = [(tier, rows) for tier, rows, *_ in tiers]
    shown = set(board.scores["entry"])
    titles = [(name, entry.title) for name, entry in packaged_entries(ground).items()]
    titles += [(name, title) for name, (_, title) in ORACLES.items()]
    cards = []
    for name, card in sorted(board.cards.items()):
        parameters = json.dumps(card.parameters, ensure_ascii=False)
        cards.append((card, board.records[name], parameters, cite_submission(card)))
    return render(
        "leaderboard.html",
        package="flgpr_ground",
        board=board,
        ground=ground,
        split=split,
        wide=leaderboard_figure(figures, board.cards),
        narrow=leaderboard_figure(figures, board.cards, narrow=True),
        tiers=tiers,
        cards=cards,
        others=[(name, title) for name, title in titles if name in shown],
        not_ranked=[(name, reason) for name, reason in board.not_ranked.items() if name in shown],
        paired_in_words=paired_in_words,
        beside_reference=beside_reference,
        citation=cite_ground(ground),
        licence=DATA_LICENCE,
    )


def _by_entry(scores: pd.DataFrame) -> dict[str, Score]:
    """Return scores by entry, the largest Pd first."""
    return {str(score["entry"]): score for score in by_pd(scores).to_dict("records")}
