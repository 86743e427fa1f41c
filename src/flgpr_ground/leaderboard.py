"""The leaderboard: submissions beside the packaged entries, as a page that is made from files."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from flgpr.door import read_named
from flgpr.report import render
from flgpr_ground.board import Board, ranked_rows, read_board
from flgpr_ground.citing import DATA_LICENCE, cite_ground, cite_submission
from flgpr_ground.entries import ORACLES, packaged_entries
from flgpr_ground.figures import leaderboard_figure
from flgpr_ground.ground import by_pd, opening_split, scores_at
from flgpr_ground.table import beside_reference, paired_in_words, write_page

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
        by_kind = {}
        for kind in _KINDS:
            by_kind[kind] = _by_entry(scores_at(board.scores, tier, split, kind))
        by_split = {}
        for name in ground.table.splits:
            by_split[name] = _by_entry(scores_at(board.scores, tier, name))
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


def _by_entry(scores: pd.DataFrame) -> dict[str, dict[Any, Any]]:
    """Return scores by entry, the largest Pd first."""
    return {str(score["entry"]): score for score in by_pd(scores).to_dict("records")}
