"""The papers' experiments by command: what it knows, and which options go together."""

import pytest
from typer.testing import CliRunner

from flgpr.commands.app import app
from flgpr.commands.reproduce import PAPERS, reproduce
from flgpr_papers import overview


def test_reproduce_names_the_papers_it_knows(tmp_path):
    told = CliRunner().invoke(app, ["reproduce", "none2001", "-o", str(tmp_path / "x")])
    assert told.exit_code == 2
    assert all(name in told.stderr for name in (*overview.PAPERS, "all"))
    assert not (tmp_path / "x").exists()
    assert tuple(overview.PAPERS) == PAPERS


@pytest.mark.parametrize(
    ("paper", "options", "rule"),
    [
        ("none2001", {}, "paper must be one of cosgrove2004, .*, all, worlds or reasons"),
        ("fuse2018", {"part": ["detection"]}, "part must be left out for fuse2018"),
        ("all", {"part": ["detection"]}, "part must be left out for all"),
        ("worlds", {"world": "as-found"}, "world must be left out, got 'as-found'"),
    ],
)
def test_options_that_do_not_go_with_a_paper_are_refused(paper, options, rule, tmp_path):
    with pytest.raises(ValueError, match=rule):
        reproduce(paper, tmp_path / "x", **options)
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
