"""Text in figures that comes from files: names of targets, lanes, runs and recipes."""

from __future__ import annotations

from typing import Any

from flgpr.model.printable import for_terminal

_TICK_LABEL = "$\\mathdefault{"
"""How Matplotlib's own labels of logarithmic axes begin, which are formulas."""


def show_dollar_signs(figure: Any) -> None:
    """Let a Matplotlib figure show the dollar signs of its texts as they are, and no control signs.

    Matplotlib takes two of them for the ends of a formula, and cannot draw a name such as
    ``$x^{$``. Call this when the figure is complete, before it is drawn.

    Parameters
    ----------
    figure : matplotlib.figure.Figure
        The figure, changed in place.
    """
    for artist in figure.findobj(_has_formulas):
        label = artist.get_text()
        if for_terminal(label) != label:  # a font has no sign for it, and UTF-8 none for halves
            artist.set_text(for_terminal(label))
        if "$" in label and _TICK_LABEL not in label:
            artist.set_parse_math(False)


def _has_formulas(artist: Any) -> bool:
    """Return whether Matplotlib reads formulas in an artist's text."""
    return hasattr(artist, "set_parse_math")
