"""Submissions that enter: scored on the sealed truth once, and listed with what their cards say."""

import json

import pandas as pd
import pytest

from flgpr.proving_ground import enter_submissions, load_ground, write_leaderboard
from flgpr.store.outputs import BusyError, locked_folder
from flgpr_ground.lanes import SEALED
from grounds import looks
from robust import digests
from submitted import CARD, write_ground, write_submission


@pytest.fixture(scope="module")
def entered(tmp_path_factory):
    """Two submissions, one of them with a hostile card, entered in a new folder."""
    home = tmp_path_factory.mktemp("entered")
    path, ground = write_ground(home)
    write_submission(home / "mine", ground, splits=("standard", "metal"))
    card = CARD.replace("hand-made", "perfect").replace(
        'method = "Alarms where the targets lie, and where none do"',
        'method = "<script>alert(1)</script> \' $x$ {{ 1 }}"',
    )
    card = card.replace('"A. Author"', '"\\"><img src=x onerror=alert(2)>"')
    write_submission(home / "perfect", ground, card=card, share=1)
    text = enter_submissions([home / "mine", home / "perfect"], home / "out", path)
    return home, text


def scores_of(out, entry):
    table = pd.read_csv(out / "scores.csv")
    return table[(table["entry"] == entry) & (table["far_allowed"] == 0.1)]


def test_what_is_found_is_what_was_put_there(entered):
    home, text = entered
    out = home / "out"
    mines = scores_of(out, "hand-made").query("split == 'standard' and group == 'mines'")
    assert list(mines["tier"]) == ["smooth", "rough"]
    assert list(mines["n_targets"]) == [8, 8]
    # A target may lie in the halo of another that has an alarm, and is then found as well.
    assert all(mines["n_detected"] >= 4)
    perfect = scores_of(out, "perfect").query("split == 'standard' and group == 'mines'")
    assert list(perfect["pd"]) == [1.0, 1.0]
    assert all(perfect["n_false"] <= 2)
    metal = scores_of(out, "hand-made").query("split == 'metal' and group == 'mines'")
    assert list(metal["n_targets"]) == [6, 6]
    assert "hand-made" in text
    costs = pd.read_csv(out / "costs.csv").query("entry == 'hand-made'")
    assert list(costs["seconds_per_km"]) == [120, 120]
    assert list(costs["training_seconds"]) == [30, 30]


def test_every_list_is_one_look_and_no_lane_was_made(entered):
    home, _ = entered
    out = home / "out"
    assert looks(out).count("score") == 6  # two tiers, of two splits and of one
    assert not list((out / "lanes").glob("*.zarr"))
    sealed = (out / "lanes" / SEALED).read_text("utf-8")
    assert "x_min" not in sealed


def test_entered_again_nothing_is_looked_at_and_other_alarms_are_refused(entered):
    home, _ = entered
    out = home / "out"
    path = home / "ground.toml"
    before = digests(out)
    enter_submissions([home / "mine"], out, path)
    assert digests(out) == before
    other = home / "other"
    write_submission(other, load_ground(False, path), share=3)
    with pytest.raises(ValueError, match=r"must have the alarms that were scored, .* smooth/stand"):
        enter_submissions([other], out, path)
    assert digests(out) == before


def test_a_split_may_be_added_under_the_same_name(entered, tmp_path):
    _, ground = write_ground(tmp_path)
    path = tmp_path / "ground.toml"
    folder = write_submission(tmp_path / "mine", ground)
    enter_submissions([folder], tmp_path / "out", path)
    more = write_submission(tmp_path / "more", ground, splits=("standard", "metal"))
    enter_submissions([more], tmp_path / "out", path)
    record = json.loads((tmp_path / "out/entries/hand-made/submission.json").read_text("utf-8"))
    assert sorted(record["alarms"]) == [
        "rough/metal", "rough/standard", "smooth/metal", "smooth/standard",
    ]  # fmt: skip
    assert looks(tmp_path / "out").count("score") == 4
    home, _ = entered
    scored = {}
    for out in (home / "out", tmp_path / "out"):
        scored[out] = scores_of(out, "hand-made").drop(columns="pd_mean").reset_index(drop=True)
    pd.testing.assert_frame_equal(*scored.values())


def test_none_is_scored_if_one_breaks_a_rule(tmp_path):
    path, ground = write_ground(tmp_path)
    good = write_submission(tmp_path / "good", ground)
    bad = write_submission(tmp_path / "bad", ground, card=CARD.replace("hand-made", "bad"))
    (bad / "fingerprints.csv").unlink()
    with pytest.raises(ValueError, match=r"submission .*bad must break no rule, got 1: fingerpr"):
        enter_submissions([good, bad], tmp_path / "out", path)
    assert not (tmp_path / "out").exists()
    with pytest.raises(ValueError, match="names of their own"):
        enter_submissions([good, good], tmp_path / "out", path)
    with pytest.raises(ValueError, match="one or more folders"):
        enter_submissions([], tmp_path / "out", path)


def test_the_name_of_an_entry_that_ran_there_is_refused(entered, tmp_path):
    home, _ = entered
    folder = home / "out" / "entries" / "ran-here"
    folder.mkdir()
    ground = load_ground(False, home / "ground.toml")
    write_submission(tmp_path / "mine", ground, card=CARD.replace("hand-made", "ran-here"))
    with pytest.raises(ValueError, match=r"a name that no other entry of .* has, got ran-here"):
        enter_submissions([tmp_path / "mine"], home / "out", home / "ground.toml")
    folder.rmdir()


def test_another_card_under_the_same_name_is_refused(tmp_path):
    path, ground = write_ground(tmp_path)
    seen = CARD.replace("test_truth_seen = false", "test_truth_seen = true")
    enter_submissions(
        [write_submission(tmp_path / "seen", ground, card=seen)], tmp_path / "out", path
    )
    before = digests(tmp_path / "out")
    blind = write_submission(tmp_path / "blind", ground)
    with pytest.raises(
        ValueError, match=r"hand-made must have the card that was scored, got anoth"
    ):
        enter_submissions([blind], tmp_path / "out", path)
    assert digests(tmp_path / "out") == before

    entry = tmp_path / "out/entries/hand-made/submission.toml"
    entry.write_text(CARD)
    rule = r"submission.toml: it must be the card that was scored, of SHA-256 \w{12} by .*, got one"
    with pytest.raises(ValueError, match=rule):
        write_leaderboard([tmp_path / "out"], tmp_path / "page.html")
    other = CARD.replace('"hand-made"', '"other"')
    submission = write_submission(tmp_path / "other", ground, card=other)
    with pytest.raises(ValueError, match=rule):
        enter_submissions([submission], tmp_path / "out", path)
    assert looks(tmp_path / "out").count("score") == 2
    entry.write_text(seen)
    write_leaderboard([tmp_path / "out"], tmp_path / "page.html")


def test_a_killed_entering_leaves_no_half_entry(tmp_path, monkeypatch):
    path, ground = write_ground(tmp_path)
    folder = write_submission(tmp_path / "mine", ground)

    def killed(*_):
        raise RuntimeError("killed")

    with monkeypatch.context() as patch:
        patch.setattr("flgpr_ground.entering.write_table", killed)
        # A killed process does not tidy up.
        patch.setattr("flgpr.store.outputs.shutil.rmtree", lambda *_, **__: None)
        with pytest.raises(RuntimeError, match="killed"):
            enter_submissions([folder], tmp_path / "out", path)
    entries = tmp_path / "out" / "entries"
    assert [entry.name for entry in entries.iterdir()] == [".partial-hand-made"]
    other = CARD.replace('"hand-made"', '"other"')
    write_submission(tmp_path / "other", ground, card=other)
    enter_submissions([tmp_path / "other"], tmp_path / "out", path)
    assert [entry.name for entry in entries.iterdir()] == ["other"]
    enter_submissions([folder], tmp_path / "out", path)
    assert len(scores_of(tmp_path / "out", "hand-made")) > 0


def test_two_processes_do_not_enter_at_once(tmp_path):
    path, ground = write_ground(tmp_path)
    folder = write_submission(tmp_path / "mine", ground)
    (tmp_path / "out").mkdir()
    with (
        locked_folder(tmp_path / "out"),
        pytest.raises(BusyError, match="out: another process is writing here"),
    ):
        enter_submissions([folder], tmp_path / "out", path)
    assert not any((tmp_path / "out").iterdir())


def test_a_page_of_something_else_is_refused_before_the_truth_is_looked_at(tmp_path):
    path, ground = write_ground(tmp_path)
    folder = write_submission(tmp_path / "mine", ground)
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "leaderboard.html").write_text("years of work")
    with pytest.raises(FileExistsError, match=r"be an older leaderboard, got .*leaderboard.html"):
        enter_submissions([folder], tmp_path / "out", path)
    assert [entry.name for entry in (tmp_path / "out").iterdir()] == ["leaderboard.html"]


def test_the_page_shows_cards_and_nothing_in_them_runs(entered):
    home, _ = entered
    for name in ("leaderboard.html", "index.html"):
        page = (home / "out" / name).read_text("utf-8")
        assert "<script" not in page
        assert "<img src=x" not in page
        assert "&lt;script&gt;alert(1)&lt;/script&gt;" in page
        assert "{{ 1 }}" in page
    page = (home / "out" / "leaderboard.html").read_text("utf-8")
    assert "http" not in page.replace("data:image", "")
    for text in ("A. Author, B. Author", "one core of a laptop", ">120</td>", "hann"):
        assert text in page
    assert "scored or opened 6 times for this page, with 6 different alarm lists" in page
