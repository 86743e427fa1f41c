"""Scores against a sealed truth are those of the open one, and every look at it is logged."""

import numpy as np
import pandas as pd
import pytest

from flgpr.model import Lane
from flgpr.scoring import operating_row, roc
from flgpr.store import lane_text
from flgpr.trials import (
    alarm_hash,
    content_hash,
    read_register,
    register,
    require_registered,
    score_blind,
    seal_truth,
)
from flgpr_trials.commands.seal import seal

LANE = Lane(0.0, 4.0, 0.0, 30.0)
TRUTH = pd.DataFrame(
    {
        "target_id": ["a", "b", "c"],
        "x": [1.123, 2.0, 3.0],
        "y": [5.0, 10.0, 15.987],
        "kind": ["metal", "metal", "plastic"],
        "depth": [0.0, np.nan, 0.1],
    }
)
ALARMS = pd.DataFrame(
    [(1.0, 5.0, 9.0), (1.0, 25.0, 7.0), (3.0, 15.5, 6.0)], columns=["x", "y", "confidence"]
)
PHRASE = "correct horse battery"


@pytest.fixture
def sealed(tmp_path):
    pytest.importorskip("cryptography")
    return seal_truth(TRUTH, LANE, tmp_path / "sealed", PHRASE)


def test_a_blind_score_is_that_of_the_open_truth_and_shows_no_place(sealed):
    score = score_blind(ALARMS, sealed, PHRASE)
    for name, subset in (
        ("all", None),
        ("metal", {"kind": "metal"}),
        ("plastic", {"kind": "plastic"}),
    ):
        curve = roc(ALARMS, TRUTH, LANE, subset=subset)
        rows = score.points[score.points["group"] == name]
        want = curve.iloc[operating_row(curve, rows["far_allowed"].to_numpy())]
        assert rows["pd"].tolist() == want["pd"].tolist()
        assert rows["far_high"].tolist() == want["far_high"].tolist()
    assert not {"threshold", "x", "y", "confidence", "target_id"} & set(score.points.columns)
    assert score.counts["n_targets"] == 3
    assert set(score.counts) == {"n_alarms", "n_targets", "area", "halo_radius", "area_rule"}


@pytest.mark.slow("runs a whole command more than once")
def test_every_look_is_logged_and_repeated_looks_show(sealed):
    book = sealed.with_name("sealed.log.jsonl")
    assert score_blind(ALARMS, sealed, PHRASE).looks == 1
    again = score_blind(ALARMS.iloc[::-1], sealed, PHRASE)
    assert (again.looks, again.lists) == (2, 1)
    other = score_blind(ALARMS.assign(confidence=[1.0, 2.0, 3.0]), sealed, PHRASE)
    assert (other.looks, other.lists) == (3, 2)
    lines = read_register(book)
    assert [line["alarms"] for line in lines[:2]] == [alarm_hash(ALARMS)] * 2
    book.write_text("".join(book.read_text().splitlines(keepends=True)[1:]))
    with pytest.raises(ValueError, match="must be unaltered"):
        score_blind(ALARMS, sealed, PHRASE)


def test_hashes_do_not_depend_on_the_order_of_rows_or_on_further_columns():
    assert alarm_hash(ALARMS) == alarm_hash(ALARMS.iloc[::-1].assign(note="n"))
    assert alarm_hash(ALARMS) != alarm_hash(ALARMS.assign(x=ALARMS["x"] + 1e-9))
    assert content_hash({"b": 1, "a": 2}) == content_hash({"a": 2, "b": 1})
    assert content_hash("") == "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855"


def test_a_register_only_grows(tmp_path):
    book = tmp_path / "book.jsonl"
    recipe = content_hash("recipe")
    with pytest.raises(ValueError, match="must be registered"):
        require_registered(book, recipe)
    register(book, recipe=content_hash("another"))
    register(book, recipe=recipe, note="first")
    register(book, recipe=recipe, note="second")
    assert require_registered(book, recipe)["note"] == "first"
    lines = book.read_text().splitlines(keepends=True)
    for bent in (
        [lines[0], lines[2]],
        [lines[1], lines[0], lines[2]],
        [lines[0], lines[1].replace("first", "other"), lines[2]],
        [lines[0], "{}\n"],
        [lines[0], "[]\n"],
    ):
        book.write_text("".join(bent))
        with pytest.raises(ValueError, match="must be unaltered"):
            read_register(book)


def test_a_sealed_truth_of_several_lanes_is_scored_as_the_open_one(tmp_path):
    pytest.importorskip("cryptography")
    lanes = {"p": LANE, "q": Lane(0, 4, 0, 40)}
    named = TRUTH.assign(lane=["p", "q", "q"])
    score = score_blind(
        ALARMS.assign(lane="q"), seal_truth(named, lanes, tmp_path / "two", PHRASE), PHRASE
    )
    assert score.counts["area"] == pytest.approx(
        roc(ALARMS.assign(lane="q"), named, lanes).attrs["area"]
    )


def test_a_target_that_no_alarm_of_the_lane_can_reach_is_no_miss(tmp_path):
    """As in the open score, which counts such targets apart."""
    pytest.importorskip("cryptography")
    far = TRUTH.assign(target_id=["a", "b", "beyond"], y=[5.0, 10.0, LANE.y_max + 10])
    score = score_blind(ALARMS, seal_truth(far, LANE, tmp_path / "sealed", PHRASE), PHRASE)
    assert score.counts["n_targets"] == 2
    assert score.counts["targets_outside"] == 1
    every = score.points[score.points["group"] == "all"]
    assert every["n_targets"].tolist() == [2] * len(every)
    assert "beyond" not in str(score)


def test_sealing_tells_the_owner_of_targets_out_of_reach(tmp_path, caplog):
    pytest.importorskip("cryptography")
    caplog.set_level("INFO", "flgpr.notes")
    (tmp_path / "truth.csv").write_text(
        "target_id,x,y,kind,depth\na,1,5,metal,5\nb,2,10,metal,0\nbeyond,1,900,metal,0\n"
    )
    (tmp_path / "lane.toml").write_text(lane_text(LANE))
    seal(tmp_path / "truth.csv", tmp_path / "lane.toml", tmp_path / "sealed", passphrase=PHRASE)
    words = caplog.text
    assert "1 of 3 targets lie more than the halo of 1 m outside" in words
    assert "are these centimetres?" in words
