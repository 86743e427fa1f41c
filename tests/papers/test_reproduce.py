"""The papers' experiments by command: what it knows, and which options go together."""

import pytest
from typer.testing import CliRunner

from flgpr.commands.app import app
from flgpr_papers import overview
from flgpr_papers.command import PAPERS, reproduce


def test_reproduce_names_the_papers_it_knows(tmp_path):
    told = CliRunner().invoke(app, ["reproduce", "none2001", "-o", str(tmp_path / "x")])
    assert told.exit_code == 2
    assert all(name in told.stderr for name in (*overview.PAPERS, "all"))
    assert not (tmp_path / "x").exists()
    assert tuple(overview.PAPERS) == PAPERS


@pytest.mark.parametrize(
    ("paper", "rule"),
    [
        ("none2001", "paper must be one of cosgrove2004, .* or all, got 'none2001'$"),
        ("worlds", "got 'worlds'; it is now python evidence/worlds$"),
        ("reasons", "got 'reasons'; it is now python evidence/reasons$"),
    ],
)
def test_what_is_no_paper_is_refused_and_what_moved_is_named(paper, rule, tmp_path):
    with pytest.raises(ValueError, match=rule):
        reproduce(paper, tmp_path / "x")
    assert not (tmp_path / "x").exists()


def test_every_paper_has_a_folder_of_its_own(monkeypatch, tmp_path):
    folders = []

    def study(paper, folder, *_):
        folders.append((paper, str(folder)))
        return folder / "index.html"

    monkeypatch.setattr("flgpr_papers.reproduce", study)
    reproduce("fuse2018")
    reproduce("all")
    assert reproduce("wang2007", tmp_path) == tmp_path / "index.html"
    assert folders == [
        ("fuse2018", "fuse2018-result"),
        ("all", "reproduced"),
        ("wang2007", str(tmp_path)),
    ]
