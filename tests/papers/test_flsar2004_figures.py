"""The figures of flsar2004."""

import pytest

from flgpr_papers.flsar2004 import figures

pytestmark = pytest.mark.slow("studies of papers")


def test_margin_touches_the_nearest_points():
    figure = figures.margin_figure()
    title = figure.axes[0].get_title()
    below, above = (float(title.split(f"D{side}1 = ")[1].split(",")[0]) for side in "-+")
    assert below == pytest.approx(above, abs=0.02)  # a hard margin lies in the middle
    assert 0.1 < below < 2
