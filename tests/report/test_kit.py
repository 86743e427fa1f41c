"""The kit of pages: what is put in is escaped, what is missing is an error, pictures have the size asked for."""

import io
import re
from pathlib import Path

import jinja2
import pytest
from matplotlib.figure import Figure
from PIL import Image

import flgpr
import flgpr_papers
from flgpr.report import figure_png, render
from flgpr.report.kit import _environment

TEMPLATES = [
    one
    for package in (flgpr, flgpr_papers)
    for one in Path(package.__file__).parent.rglob("templates/*.html")
]
EXTENDS = ('{% extends "page.html" %}', '{% extends "paper.html" %}')
OVERVIEW = {
    "papers": {"a2000": "A & B"},
    "pages": {},
    "found": {},
    "quick": False,
    "as_found": False,
    "other": "",
    "verdicts": ("agrees", "disagrees"),
    "no_verdict": "no verdict",
}


@pytest.mark.parametrize("path", TEMPLATES, ids=lambda path: path.stem)
def test_pages_take_nothing_from_elsewhere(path):
    text = path.read_text(encoding="utf-8")
    assert "://" not in text
    assert "|safe" not in text
    partials = ("page.html", "parts.html", "study.html", "trial.html", "checklist.html")
    assert path.name in partials or text.startswith(EXTENDS)


def test_a_page_of_another_package_stands_on_the_kit():
    found = {"a2000": [("x < y", "2 & 3", "<b>1</b>", "agrees")]}
    page = render("overview.html", "flgpr_papers", **OVERVIEW | {"found": found})
    assert page.startswith("<!doctype html>")
    assert "A &amp; B" in page
    assert "x &lt; y" in page
    assert "&lt;b&gt;1" in page
    assert f"flgpr {flgpr.__version__}." in page


@pytest.mark.parametrize(
    ("value", "said"),
    [
        (0.1 + 0.2, "0.3"),
        (-2.22e-16, "0"),
        (4.199999999999999, "4.2"),
        (1234567.891, "1234567.89"),
        (-100.0, "-100"),
    ],
)
def test_places_are_said_to_the_centimetre(value, said):
    places = {"x_min": value, "x_max": 2.0, "y_min": 0.0, "y_max": 60.0}
    page = render(
        "sheet.html",
        "flgpr_trials",
        name="",
        digest="",
        lanes=[("a", places, [], [])],
        count=0,
        crs="",
        sigma=0.0,
    )
    assert f"Lane a: x {said} to 2 m, y 0 to 60 m" in page


def test_what_is_missing_is_an_error():
    with pytest.raises(jinja2.UndefinedError, match="quick"):
        render(
            "overview.html", "flgpr_papers", **{k: v for k, v in OVERVIEW.items() if k != "quick"}
        )
    with pytest.raises(jinja2.TemplateNotFound):
        render("overview.html")


def test_pictures_have_the_size_asked_for():
    figure = Figure(figsize=(2, 1))
    figure.add_subplot().plot([0, 1])
    assert Image.open(io.BytesIO(figure_png(figure, 50))).size == (100, 50)
    assert Image.open(io.BytesIO(figure_png(figure, 120))).size == (240, 120)
    assert figure_png(figure) == figure_png(figure)


def test_a_narrow_screen_keeps_names_on_a_line_and_pictures_legible():
    parts = "{% import 'parts.html' as parts %}"
    page = _environment("flgpr.report").from_string(
        parts
        + "{{ parts.table(['alarm', 'of'], [['alarm-1', 'a-b c']]) }}{{ parts.picture(figure, '', 50) }}"
    )
    figure = Figure(figsize=(9.5, 1))
    for picture in (figure, figure_png(figure, 50)):
        shown = page.render(figure=picture)
        assert "<td class=name>alarm-1</td><td>a-b c</td>" in shown
        assert 'style="--inches: 9.5"' in shown


@pytest.mark.parametrize("path", TEMPLATES, ids=lambda path: path.stem)
def test_every_column_of_a_table_has_a_header(path):
    """A reader who hears the page is told with each cell what its column is."""
    text = path.read_text(encoding="utf-8")
    assert not re.findall(r"<th[^>]*>\s*</th>", text)
    heads = re.findall(r"parts\.table\((\[.*?\])", text, re.DOTALL)
    assert not [head for head in heads if '""' in head]
