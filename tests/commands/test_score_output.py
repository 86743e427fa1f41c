"""Files of a score: what is there stays, what differs is refused, what is missing is written."""

import pytest

from flgpr.commands.score_output import must_write, with_last, write_score_files

FILES = {"roc.json": "{}", "figures/roc.png": b"png", "report.html": "page"}


def test_files_are_written_into_folders(tmp_path):
    write_score_files(tmp_path / "score", FILES)
    assert (tmp_path / "score" / "figures" / "roc.png").read_bytes() == b"png"
    assert (tmp_path / "score" / "report.html").read_text() == "page"


def test_the_same_files_stay_and_others_are_refused(tmp_path, caplog):
    write_score_files(tmp_path, FILES)
    with caplog.at_level("INFO", "flgpr.outputs"):
        write_score_files(tmp_path, FILES, overwrite=False)
    assert "exists already" in caplog.text
    with pytest.raises(FileExistsError, match=r"roc\.json, which holds something else"):
        write_score_files(tmp_path, FILES | {"roc.json": "[]"}, overwrite=False)
    write_score_files(tmp_path, FILES | {"roc.json": "[]"})
    assert (tmp_path / "roc.json").read_text() == "[]"


def test_a_missing_file_is_written_beside_the_same_ones(tmp_path):
    write_score_files(tmp_path, FILES)
    (tmp_path / "report.html").unlink()
    assert must_write(tmp_path, FILES, overwrite=False)
    write_score_files(tmp_path, FILES, overwrite=False)
    assert (tmp_path / "report.html").read_text() == "page"


def test_without_the_last_file_the_others_are_of_no_score(tmp_path):
    (tmp_path / "report.html").write_text("the page of an interrupted score")
    assert must_write(tmp_path, FILES, overwrite=False, last_file="roc.json")
    with pytest.raises(FileExistsError):
        must_write(tmp_path, FILES, overwrite=False)


def test_the_last_file_is_put_at_the_end():
    assert list(with_last(FILES, "roc.json")) == ["figures/roc.png", "report.html", "roc.json"]
    assert list(with_last(FILES, "nothing")) == list(FILES)
