"""The command line in a folder that somebody else made: it takes no modules or settings from there."""

import sys

import pytest

from flgpr import __main__ as entry


def test_settings_of_libraries_in_the_working_folder_are_refused(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", list(sys.path))
    (tmp_path / "matplotlibrc").touch()
    with pytest.raises(SystemExit) as caught:
        entry.main()
    assert caught.value.code == 2
    assert "got matplotlibrc, which Matplotlib would obey" in capsys.readouterr().err


def test_the_working_folder_is_no_place_of_modules(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [str(tmp_path), "elsewhere"])
    entry._leave_out_working_folder()
    assert sys.path == ["elsewhere"]


def test_another_first_folder_stays(tmp_path, monkeypatch):
    (tmp_path / "work").mkdir()
    monkeypatch.chdir(tmp_path / "work")
    monkeypatch.setattr(sys, "path", [str(tmp_path), "elsewhere"])
    entry._leave_out_working_folder()
    assert sys.path == [str(tmp_path), "elsewhere"]
