"""Settings of a study: the packaged TOML, with a quick table laid over it and nothing unknown allowed."""

import pytest
from pydantic import ValidationError

from flgpr_papers.flsar2004.lanes import Settings
from flgpr_papers.kit.settings import PAPERS, Table, packaged, packaged_text
from flgpr_papers.kit.study_worlds import study_world

pytestmark = pytest.mark.slow("studies of papers")


class Small(Table):
    value: int = 1


def test_every_paper_has_settings():
    for paper in PAPERS:
        assert packaged_text(paper).strip()


def settings(quick=False, **more):
    """Return the settings of flsar2004, whose scenes its world gives."""
    scenes = {"scenes": study_world("flsar2004").sites}
    return packaged("flsar2004", Settings, quick, scenes | more)


def test_a_quick_run_changes_some_entries_only():
    full = settings()
    quick = settings(quick=True)
    assert quick.length < full.length
    assert quick.spacing == full.spacing


def test_other_entries_are_laid_over_in_any_case():
    assert settings().classify.p0 != 0.25
    for quick in (False, True):
        assert settings(quick, classify={"p0": 0.25}).classify.p0 == 0.25


def test_unknown_entries_are_refused():
    with pytest.raises(ValidationError, match="Extra inputs"):
        Small(other=2)
