"""Coarse figures: whether they can be drawn does not depend on their resolution."""

import pytest

from flgpr.report import figure_png
from flgpr_papers.kit import page


@pytest.fixture(scope="session", autouse=True)
def coarse_figures():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(page, "figure_png", lambda figure, dpi: figure_png(figure, 30))
        yield
