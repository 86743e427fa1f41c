"""The leaderboard: ranks that intervals allow, the packaged scores, and tables that are refused."""

import csv
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg

from flgpr.proving_ground import load_ground, write_leaderboard
from flgpr.scoring import clopper_pearson
from flgpr_ground.board import (
    PACKAGED,
    Board,
    Row,
    leaderboard_html,
    packaged_board,
    ranked_rows,
    read_board,
)
from flgpr_ground.card import parse_card
from flgpr_ground.figures import leaderboard_figure
from flgpr_ground.ground import scores_at
from reading import ROOT
from submitted import CARD, write_ground


def board_of(ground, found, total=200):
    """Return a board of entries that find so many mines on the tier "smooth"."""
    rows = []
    for name, count in found.items():
        low, high = clopper_pearson(count, total)
        rows.append(
            {
                "tier": "smooth", "entry": name, "split": "standard", "group": "mines",
                "far_allowed": ground.table.far, "n_detected": count, "n_targets": total,
                "n_false": 9, "area": 90.0, "chance": 0.05, "only": np.nan,
                "reference_only": np.nan, "p": np.nan, "pd": count / total,
                "pd_low": low, "pd_high": high,
            }
        )  # fmt: skip
    return Board(ground, pd.DataFrame(rows), {}, dict.fromkeys(found, PACKAGED))


@pytest.fixture
def ground(tmp_path):
    return write_ground(tmp_path)[1]


def smooth_rows(board):
    return ranked_rows(board, board.ground.chosen_tiers("smooth")[0], "standard")


def ranks(board):
    return {row.entry: row.rank for row in smooth_rows(board)}


def test_entries_whose_intervals_lie_apart_have_ranks(ground):
    board = board_of(ground, {"last": 20, "first": 180, "middle": 100})
    assert ranks(board) == {"first": "1", "middle": "2", "last": "3"}
    assert [row.unclear for row in smooth_rows(board)] == [(), (), ()]


def test_entries_whose_intervals_overlap_have_none(ground):
    board = board_of(ground, {"a": 100, "b": 105, "c": 110, "far": 20})
    assert ranks(board) == {"c": "1 to 3", "b": "1 to 3", "a": "1 to 3", "far": "4"}
    rows = {row.entry: row.unclear for row in smooth_rows(board)}
    assert set(rows["a"]) == {"b", "c"}


def test_overlap_is_no_chain(ground):
    """The first and the last of three may be told apart while the middle one is from neither."""
    board = board_of(ground, {"high": 120, "middle": 105, "low": 90})
    assert ranks(board) == {"high": "1 to 2", "middle": "1 to 3", "low": "2 to 3"}


def test_who_saw_the_test_lanes_and_the_oracle_are_shown_without_a_rank(ground):
    board = board_of(ground, {"oracle": 190, "hand-made": 150, "fair": 100})
    card, _ = parse_card(CARD.replace("test_lanes_seen = false", "test_lanes_seen = true").encode())
    board.cards["hand-made"] = card
    board.records["hand-made"] = {}
    shown = ranks(board)
    assert shown == {"fair": "1", "oracle": "not ranked", "hand-made": "not ranked"}
    assert next(iter(shown)) == "fair"  # the others stand below
    page = leaderboard_html(board)
    assert "hand-made (its card says that test lanes were seen)" in page
    assert "fair is first and finds 100 of 200 mines, Pd 0.50 (0.43 to 0.57); not compared" in page


def test_the_packaged_scores_are_those_of_the_evidence():
    ground = load_ground()
    board = packaged_board(ground)
    for tier, of_tier in zip(ground.table.tiers, ground.chosen_tiers(), strict=True):
        text = (ROOT / "docs" / "evidence" / "benchmark" / f"{tier}.csv").read_text("utf-8")
        rows = list(csv.DictReader(text.splitlines()))
        mines = scores_at(board.scores, of_tier, "standard").set_index("entry")
        assert set(mines.index) == {row["entry"] for row in rows}
        for row in rows:
            score = mines.loc[row["entry"]]
            assert row["mines"] == f"{score['n_detected']} of {score['n_targets']}"
            interval = f"{score['pd']:.2f} ({score['pd_low']:.2f} to {score['pd_high']:.2f})"
            assert row["Pd, 95 % interval"] == interval
            cost = board.costs.get((tier, row["entry"]), float("nan"))
            shown = "·" if np.isnan(cost) else f"{cost:.0f}"
            assert row["processor s per km"] == shown


def test_the_quick_form_and_other_grounds_have_no_packaged_scores(ground):
    assert packaged_board(load_ground(True)).scores.empty
    assert packaged_board(ground).scores.empty
    text = load_ground().text.replace("length = 243.0", "length = 242.0")
    renamed = load_ground(False, text)
    assert renamed.title == "proving-ground-2"
    assert packaged_board(renamed).scores.empty


def folder_of(home, path, scores):
    """Write a folder as `flgpr benchmark enter` leaves one, with these scores."""
    folder = home / "out"
    folder.mkdir(exist_ok=True)
    (folder / "ground.toml").write_text(path.read_text("utf-8"))
    (folder / "ground.json").write_text('{"ground": "tiny-3", "quick": false}')
    scores.to_csv(folder / "scores.csv", index=False)
    return folder


def test_a_page_of_a_folder_replaces_an_older_one_and_nothing_else(tmp_path, ground):
    folder = folder_of(tmp_path, tmp_path / "ground.toml", board_of(ground, {"a": 1}).scores)
    page = write_leaderboard([folder], tmp_path / "page.html")
    first = page.read_bytes()
    folder_of(tmp_path, tmp_path / "ground.toml", board_of(ground, {"a": 1, "b": 2}).scores)
    write_leaderboard([folder], page)
    assert page.read_bytes() != first
    (tmp_path / "thesis.html").write_text("years of work")
    with pytest.raises(FileExistsError, match="an older leaderboard"):
        write_leaderboard([folder], tmp_path / "thesis.html")


@pytest.mark.parametrize(
    ("column", "value"),
    [
        ("n_detected", 300), ("n_detected", -1), ("n_detected", "many"), ("n_targets", 0),
        ("n_detected", 0.5), ("chance", np.inf), ("split", "average"), ("tier", "moon"), ("entry", None),
    ],
)  # fmt: skip
def test_a_table_of_scores_that_cannot_be_is_refused(column, value, tmp_path, ground):
    scores = board_of(ground, {"a": 1, "b": 2}).scores.astype(object)
    scores.loc[1, column] = value
    folder = folder_of(tmp_path, tmp_path / "ground.toml", scores)
    with pytest.raises(ValueError, match=r"scores\.csv must have counts .* got 1 rows without"):
        read_board([folder])


def test_tables_of_two_grounds_without_columns_and_of_one_entry_twice_are_refused(tmp_path, ground):
    scores = board_of(ground, {"a": 1}).scores
    folder = folder_of(tmp_path, tmp_path / "ground.toml", scores.drop(columns="area"))
    with pytest.raises(ValueError, match=r"scores\.csv must have the columns area"):
        read_board([folder])
    folder = folder_of(tmp_path, tmp_path / "ground.toml", scores)
    with pytest.raises(ValueError, match="entries of different names, got a twice"):
        read_board([folder, folder])
    folder = folder_of(tmp_path, tmp_path / "ground.toml", pd.concat([scores, scores]))
    with pytest.raises(ValueError, match="one row per entry"):
        read_board([folder])
    (folder / "scores.csv").unlink()
    with pytest.raises(ValueError, match="folders must hold scores, got none"):
        read_board([folder])


def test_names_of_entries_are_text_on_the_page(ground):
    board = board_of(ground, {"<b>bold</b>": 100, "$\\frac{1}": 90})
    page = leaderboard_html(board)
    assert "<b>bold</b>" not in page
    assert "&lt;b&gt;bold" in page
    assert leaderboard_html(replace(board)) == page


@pytest.mark.parametrize(("tiers", "narrow"), [(1, False), (1, True), (2, False)])
def test_no_legend_is_cut(tiers, narrow):
    score = dict.fromkeys(("pd", "pd_low", "pd_high", "chance", "n_targets"), 0.5)
    rows = [Row("mine", "", score, 1, 1)]
    grounds = load_ground(quick=True).chosen_tiers()[:tiers]
    figure = leaderboard_figure([(ground, rows) for ground in grounds], ("mine",), narrow)
    FigureCanvasAgg(figure).draw()
    (legend,) = figure.legends
    box = legend.get_window_extent()
    assert box.x0 >= 0
    assert box.x1 <= figure.bbox.x1
