"""Coarse figures: whether they can be drawn depends on neither their resolution, where the axes lie nor plain ticks."""

from io import BytesIO

import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.ticker import AutoLocator, NullLocator

from flgpr_papers.kit import page


@pytest.fixture(scope="session", autouse=True)
def coarse_figures():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(page, "figure_png", _coarse)
        yield


def _coarse(figure, _dpi):
    figure.set_layout_engine(
        "none"
    )  # fitting axes about their labels takes longer than drawing them
    for axis in (one for axes in figure.axes for one in (axes.xaxis, axes.yaxis)):
        if type(axis.get_major_locator()) is AutoLocator:
            axis.set_major_locator(NullLocator())
    figure.dpi = 30
    stream = BytesIO()
    FigureCanvasAgg(figure).print_png(stream)  # savefig draws twice
    return stream.getvalue()
