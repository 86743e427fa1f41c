"""Coarse figures: whether they can be drawn depends neither on their resolution nor on where the axes lie."""

from io import BytesIO

import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg

from flgpr_papers.kit import page


@pytest.fixture(scope="session", autouse=True)
def coarse_figures():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(page, "figure_png", _coarse)
        yield


def _coarse(figure, _dpi):
    figure.set_layout_engine("none")  # fitting axes about their labels takes longer than drawing them
    figure.dpi = 30
    stream = BytesIO()
    FigureCanvasAgg(figure).print_png(stream)  # savefig draws twice
    return stream.getvalue()
