"""Settings of a study: the packaged TOML, with a quick table laid over it and nothing unknown allowed."""

import pytest
from pydantic import ValidationError

from flgpr_papers.flsar2004.lanes import Settings
from flgpr_papers.kit.settings import PAPERS, Table, packaged, packaged_text


class Small(Table):
    value: int = 1


def test_every_paper_has_settings():
    for paper in PAPERS:
        assert packaged_text(paper).strip()


def test_a_quick_run_changes_some_entries_only():
    full = packaged("flsar2004", Settings)
    quick = packaged("flsar2004", Settings, quick=True)
    assert quick.length < full.length
    assert quick.spacing == full.spacing


def test_other_entries_are_laid_over_in_any_case():
    full = packaged("flsar2004", Settings)
    classify = {"classify": {"p0": 0.25}}
    assert full.classify.p0 != 0.25
    assert packaged("flsar2004", Settings, more=classify).classify.p0 == 0.25
    assert packaged("flsar2004", Settings, quick=True, more=classify).classify.p0 == 0.25


def test_unknown_entries_are_refused():
    with pytest.raises(ValidationError, match="Extra inputs"):
        Small(other=2)
