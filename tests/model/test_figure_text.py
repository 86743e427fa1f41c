"""Text in figures that comes from files."""

import pytest
from matplotlib.figure import Figure

from flgpr.model.figure_text import show_dollar_signs


def test_a_name_that_is_no_formula_is_drawn_as_it_is(tmp_path):
    figure = Figure()
    axes = figure.subplots()
    axes.set_title("lane $x^{$")
    with pytest.raises(ValueError, match="Expected end_group"):
        figure.savefig(tmp_path / "a.png")
    show_dollar_signs(figure)
    figure.savefig(tmp_path / "a.png")
    assert axes.title.get_text() == "lane $x^{$"
    assert not axes.title.get_parse_math()


def test_labels_of_logarithmic_axes_stay_formulas():
    figure = Figure()
    axes = figure.subplots()
    axes.set_xscale("log")
    axes.set_xlim(1, 1000)
    figure.canvas.draw()
    show_dollar_signs(figure)
    labels = [label for label in axes.get_xticklabels() if "mathdefault" in label.get_text()]
    assert labels
    assert all(label.get_parse_math() for label in labels)
