"""What the pages of the studies share: their templates and figures that say if a run was quick."""

from __future__ import annotations

from typing import Any

from matplotlib.figure import Figure

from flgpr.report import figure_png, render
from flgpr_papers.kit.findings import MARGIN, VERDICTS


def study_html(template: str, **values: Any) -> str:
    """Fill in one of ``flgpr_papers/templates``; the page needs nothing beside it."""
    return render(template, "flgpr_papers", verdicts=VERDICTS, margin=MARGIN, **values)


def draw(figure: Figure, quick: bool, dpi: float = 110) -> bytes:
    """Render a figure as PNG, marked if the run was quick."""
    if quick:
        figure.text(
            0.5, 0.5, "quick run", fontsize=34, color="#cc0000", alpha=0.25, rotation=20, ha="center", va="center"
        )
    return figure_png(figure, dpi)
