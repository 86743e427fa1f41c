"""Submissions: a good one is read, and everything that is wrong with a bad one is found at once."""

import os

import pandas as pd
import pytest

from flgpr.proving_ground import check_submission, load_ground
from flgpr_ground import submission
from flgpr_ground.lanes import packaged_fingerprints
from submitted import CARD, prints_of, write_ground, write_submission


@pytest.fixture
def ground(tmp_path):
    return write_ground(tmp_path)


def checked(folder, ground):
    return check_submission(folder, ground[0])


def one_fault(folder, ground):
    [fault] = checked(folder, ground).faults
    return fault


def list_of(folder, lane="smooth-sand-test-1", split="standard"):
    return folder / split / lane / "alarms.csv"


def test_a_submission_is_read_with_its_lanes(tmp_path, ground):
    folder = write_submission(tmp_path / "mine", ground[1], splits=("standard", "metal"))
    (folder / "notes.txt").write_text("nothing that is read")
    found = checked(folder, ground)
    assert found.faults == ()
    assert found.name == "hand-made"
    assert set(found.alarms) == {"standard", "metal"}
    assert found.lanes["standard"] == (
        "rough-sand-bare-1", "rough-sand-test-1", "smooth-sand-bare-1", "smooth-sand-test-1",
    )  # fmt: skip
    counts = found.alarms["standard"].groupby("lane").size()
    assert counts["smooth-sand-test-1"] == 5  # four of eight targets, and a false alarm
    assert counts["smooth-sand-bare-1"] == 1
    assert any("1 other file not read: notes.txt" in note for note in found.notes)
    assert any("6 lanes have no fingerprint of the authors" in note for note in found.notes)


def test_one_tier_alone_may_be_entered(tmp_path, ground):
    folder = write_submission(tmp_path / "mine", ground[1], tiers=("rough",))
    found = checked(folder, ground)
    assert found.faults == ()
    assert set(found.alarms["standard"]["lane"]) == {"rough-sand-test-1", "rough-sand-bare-1"}


def test_a_lane_without_alarms_has_a_header_alone(tmp_path, ground):
    folder = write_submission(tmp_path / "mine", ground[1])
    list_of(folder).write_text("x,y,confidence\n")
    found = checked(folder, ground)
    assert found.faults == ()
    assert "smooth-sand-test-1" in found.lanes["standard"]
    assert "smooth-sand-test-1" not in set(found.alarms["standard"]["lane"])


@pytest.mark.parametrize(
    ("table", "fault"),
    [
        ("x,y\n1,2\n", "must have the columns x, y (m, in the lane frame) and confidence, got x, y"),
        ("x_cm,y_cm,score\n1,2,3\n", "`flgpr import table` converts other names and units"),
        ("x,y,confidence\n0,1,2\n0,2,inf\n0,3,-inf\n", "must be a finite number, got 'inf' in line 3 (2 rows)"),
        ("x,y,confidence\nzero,1,2\n", "x must be a finite number, got 'zero' in line 2 (1 row)"),
        ("x,y,confidence\n,1,2\n", "x must be a finite number, got 'nan' in line 2 (1 row)"),
        (
            "x,y,confidence\n0,1,2\n9,5,1\n0,50,1\n",
            "must lie in the lane (x -1.5 to 1.5 m, y 0 to 40 m) or at most 2 m outside, "
            "got x = 9, y = 5 in line 3 (2 rows)",
        ),
        ("x,y,confidence\n0,1,2\n0,1,3\n0,1,4\n", "places of their own, got x = 0, y = 1 again in line 3 (2 rows)"),
        ("alarm_id,x,y,confidence\na,0,1,2\na,0,3,3\n", "alarm_id must be unique, got 'a' again in line 3 (1 row)"),
        ("x,y,confidence,lane\n0,1,2,elsewhere\n", "lane must be smooth-sand-test-1 or empty, got 'elsewhere'"),
        ("", "must be a table of alarms"),
        ("x,y,confidence\n\"0,1,2\n", "must be a table of alarms"),
        ("x;y,confidence\n0;1,2\n", "must be a table of alarms"),
    ],
)  # fmt: skip
def test_an_alarm_list_that_breaks_a_rule_is_named(table, fault, tmp_path, ground):
    folder = write_submission(tmp_path / "mine", ground[1])
    list_of(folder).write_text(table)
    line = one_fault(folder, ground)
    assert line.startswith("standard/smooth-sand-test-1/alarms.csv: ")
    assert fault in line


def test_alarms_just_outside_the_lane_are_counted_and_kept(tmp_path, ground):
    folder = write_submission(tmp_path / "mine", ground[1])
    list_of(folder).write_text("x,y,confidence\n3.4,5,1\n0,-1.9,1\n0,5,1\n")
    found = checked(folder, ground)
    assert found.faults == ()
    assert any(
        note.startswith("standard: 2 of 10 alarms lie outside their lanes") for note in found.notes
    )
    assert (found.alarms["standard"]["lane"] == "smooth-sand-test-1").sum() == 3


def test_alarms_that_all_lie_outside_are_a_fault_however_near_they_are(tmp_path, ground):
    folder = write_submission(tmp_path / "mine", ground[1])
    for path in folder.rglob("alarms.csv"):
        path.write_text("x,y,confidence\n3.4,5,1\n0,-1.9,1\n")
    faults = checked(folder, ground).faults
    assert any("alarms must lie in their lanes, all " in fault for fault in faults)


def test_all_faults_are_found_at_once(tmp_path, ground):
    card = CARD.replace("2026-11-20", '"never"').replace('"hann"', '"\\u0007"')
    folder = write_submission(tmp_path / "mine", ground[1], card=card)
    assert len(checked(folder, ground).faults) == 2  # the ground is not known without a card
    (folder / "submission.toml").write_text(CARD)
    list_of(folder).write_text("x,y,confidence\nnan,1,2\n0,99,3\n")
    list_of(folder, "rough-sand-bare-1").unlink()
    (folder / "standard" / "smooth-sand-bare-1").rename(folder / "standard" / "smooth-sand-1")
    (folder / "average").mkdir()
    (folder / "fingerprints.csv").unlink()
    faults = checked(folder, ground).faults
    expected = (
        "average: folders must be named after splits, standard, metal",
        "standard/rough-sand-bare-1/alarms.csv: a lane's alarms must be there",
        "standard/smooth-sand-test-1/alarms.csv: x must be a finite number",
        "standard/smooth-sand-test-1/alarms.csv: alarms must lie in the lane",
        "got 1 that are none: smooth-sand-1",
        "standard: all 2 test lanes must be there",
        "fingerprints.csv: the fingerprints of the lanes",
    )
    assert len(faults) == len(expected), faults
    for text in expected:
        assert [text in fault for fault in faults].count(True) == 1, text


def test_the_name_of_a_packaged_entry_is_refused(tmp_path, ground):
    for name in ("wang2007", "oracle"):
        card = CARD.replace("hand-made", name)
        folder = write_submission(tmp_path / name, ground[1], card=card)
        assert f"must not be that of a packaged entry, got '{name}'" in one_fault(folder, ground)


def test_another_ground_is_refused(tmp_path, ground):
    folder = write_submission(tmp_path / "mine", ground[1], card=CARD.replace("tiny-3", "tiny-2"))
    assert "ground must be tiny-3, got 'tiny-2'" in one_fault(folder, ground)
    [fault] = check_submission(folder).faults
    assert "proving-ground-2 or proving-ground-2-quick" in fault


def test_lanes_with_other_echoes_are_refused(tmp_path):
    quick = load_ground(True)
    card = CARD.replace("tiny-3", quick.title)
    folder = write_submission(tmp_path / "mine", quick, card=card)
    table = prints_of(quick)
    table.to_csv(folder / "fingerprints.csv", index=False)
    [fault] = check_submission(folder).faults
    assert "lanes must be those of proving-ground-2-quick, got 8 with other echoes" in fault
    known = packaged_fingerprints(quick)
    known.assign(sha256="f" * 64).reset_index().to_csv(folder / "fingerprints.csv", index=False)
    found = check_submission(folder)
    assert found.faults == ()
    assert found.likeness == {"alike": 8}
    known.iloc[1:].reset_index().to_csv(folder / "fingerprints.csv", index=False)
    assert check_submission(folder).likeness == {"same bits": 7}
    tested = known.index.str.contains("-test-")
    known[~tested].reset_index().to_csv(folder / "fingerprints.csv", index=False)
    [fault] = check_submission(folder).faults
    assert "every test lane that was searched must be in it, got 4 that are not" in fault


@pytest.mark.parametrize("data", ["", "a,b\n1,2\n", "lane,sha256\nx,1\nx,2\n", "\0" * 50])
def test_a_table_of_fingerprints_that_cannot_be_read_is_named(data, tmp_path, ground):
    folder = write_submission(tmp_path / "mine", ground[1])
    (folder / "fingerprints.csv").write_text(data)
    assert one_fault(folder, ground).startswith("fingerprints.csv: ")


def replace_by(path, kind):
    path.unlink()
    if kind == "pipe":
        os.mkfifo(path)
    elif kind == "folder":
        path.mkdir()
    elif kind == "link":
        path.symlink_to("/etc/passwd")
    elif kind == "large":
        path.touch()
        os.truncate(path, 2**31)


@pytest.mark.parametrize("kind", ["pipe", "folder", "link", "large"])
@pytest.mark.parametrize(
    "name", ["submission.toml", "fingerprints.csv", "standard/smooth-sand-test-1/alarms.csv"]
)
def test_what_is_no_plain_small_file_is_not_read(name, kind, tmp_path, ground):
    folder = write_submission(tmp_path / "mine", ground[1])
    replace_by(folder / name, kind)
    faults = checked(folder, ground).faults
    assert faults
    assert any(name in fault for fault in faults)
    assert not any("root:" in fault for fault in faults)


def test_a_folder_behind_a_link_is_not_entered(tmp_path, ground):
    folder = write_submission(tmp_path / "mine", ground[1])
    (folder / "standard").rename(tmp_path / "elsewhere")
    (folder / "standard").symlink_to(tmp_path / "elsewhere", target_is_directory=True)
    assert (
        "standard must be a file or a folder, got a symbolic link" in checked(folder, ground).faults
    )


def test_numbers_of_files_and_alarms_are_bounded(tmp_path, ground, monkeypatch):
    folder = write_submission(tmp_path / "mine", ground[1])
    monkeypatch.setattr(submission, "MOST_ALARMS", 4)
    assert "a lane must have at most 4 alarms, got 5" in checked(folder, ground).faults[0]
    monkeypatch.setattr(submission, "MOST_ENTRIES", 3)
    faults = checked(folder, ground).faults
    assert "standard: it must hold at most 3 files, got more" in faults


def test_an_empty_folder_and_no_folder(tmp_path, ground):
    (tmp_path / "empty").mkdir()
    assert "the card must be there, got no such file" in one_fault(tmp_path / "empty", ground)
    with pytest.raises(NotADirectoryError, match="a submission must be a folder"):
        check_submission(tmp_path / "none")
    folder = write_submission(tmp_path / "bare", ground[1], splits=())
    assert "alarms must be there for one split at least, of standard, metal" in one_fault(
        folder, ground
    )


def test_nothing_of_a_submission_with_faults_is_handed_on(tmp_path, ground):
    folder = write_submission(tmp_path / "mine", ground[1])
    list_of(folder).write_text("x,y\n")
    found = checked(folder, ground)
    assert found.alarms == {}
    assert isinstance(found.lanes["standard"], tuple)
    assert pd.DataFrame(prints_of(ground[1])).shape == (6, 3)
