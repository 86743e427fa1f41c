"""The page of a verdict, as HTML and as PDF: the sentence, the ROC, and tables by kind, depth and lane."""

from __future__ import annotations

import io
import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.backends.backend_pdf import PdfPages
from matplotlib.figure import Figure
from matplotlib.image import imread
from matplotlib.lines import Line2D

from flgpr.model import Lane
from flgpr.model.figure_text import show_dollar_signs
from flgpr.report.comparison_page import POINT
from flgpr.report.curve_figures import compared_roc_figure
from flgpr.report.kit import figure_png, render, table_rows
from flgpr.report.trial_block import comparison_block, lanes_in_words
from flgpr.types import FloatArray
from flgpr_trials.verdict import Verdict

_GROUP_TITLES = {"kind": "By kind", "depth": "By depth", "lane": "By lane"}
_PAIR = {
    "difference of": "{first} less {second}",
    ">Pd": "{difference:+.2f}",
    ">interval": "{low:+.2f} to {high:+.2f}",
    ">found by one alone": "{only_first} and {only_second}",
    ">p (McNemar)": "{p:.3g}",
    ">p (Holm)": "{p_held:.3g}",
}
_PAGE = (8.27, 11.69)  # A4, inches
_LEFT, _RIGHT, _TOP, _BOTTOM = 0.08, 0.92, 0.95, 0.06  # of a page
_LINE = 0.0148  # height of a line of a table, of a page
_LETTER = 0.0082  # width of a letter of 8 points, of a page
_SHORT = 24  # rows of a table that is not divided
_MOST_CELL = 64  # characters of a cell of the PDF


@dataclass(frozen=True)
class PageTable:
    """A table of a page; a title that begins with ``>`` is of a column of numbers."""

    title: str
    head: Sequence[str]
    rows: list[list[str]]


def verdict_tables(verdict: Verdict) -> list[PageTable]:
    """Return the tables of a verdict: vendors, kind, depth, lane, and pairs of vendors."""
    confidence = f"{100 * verdict.requirement.confidence:g} %"
    vendor = {"vendor": "{detector}"}
    point = list(POINT.items())
    shown = {f">Pd at least ({confidence})": "{at_least:.2f}", "shown": "{shown}"}
    columns = {**vendor, **dict(point[:3]), **shown, **dict(point[3:])}
    points = verdict.points.assign(shown=verdict.points["shows"].map({True: "yes", False: "no"}))
    tables = [_page_table("At the registered false alarm rate", columns, points)]
    for column, table in verdict.groups.items():
        columns = {column: f"{{{column}}}", **vendor, **dict(point[:4])}
        tables.append(_page_table(_GROUP_TITLES[column], columns, table))
    if len(verdict.pairs):
        tables.append(_page_table("Vendors against each other", _PAIR, verdict.pairs))
    return tables


def _page_table(title: str, columns: Mapping[str, str], table: pd.DataFrame) -> PageTable:
    """Return a table by the formats of its cells, which stand by the titles of the columns."""
    return PageTable(title, list(columns), table_rows(table, columns.values()))


def _roc(verdict: Verdict) -> Figure:
    """Draw the ROC of all vendors."""
    labels = {name: name for name in verdict.curves}
    far_max = max(verdict.rules.far_max, 2 * verdict.requirement.far)
    return compared_roc_figure(verdict.curves, labels, verdict.points, far_max)


def _notes_on_points(verdict: Verdict) -> list[str]:
    """Return what has to be known to read the figures."""
    level = f"{100 * verdict.rules.level:g} %"
    notes = [
        f"Exact {level} intervals, point by point. Chance is the Pd that these alarms would have if "
        "they knew nothing of the mines. The threshold of a list is the lowest that keeps the "
        "registered rate on these lanes; the interval of the false alarm rate says how far that "
        "carries to other ground. An alarm in the halo of two mines finds both.",
    ]
    if len(verdict.pairs):
        notes.append(
            "Each claim has its confidence by itself. Vendors are told apart by McNemar's exact "
            "test on the mines that one alone finds, with Holm's correction where there are "
            "several pairs; the false alarms are taken as given. Tango's interval of a difference "
            "is less strict: it may lie beside 0 where the test tells nothing apart."
        )
    area = verdict.points["area"].iloc[0]
    if verdict.requirement.far * area < 1:
        notes.append(
            f"{area:.0f} m² outside the halos are too small for {verdict.requirement.far:g} false "
            "alarms per m²: not a single one is allowed."
        )
    return notes


def _lead(verdict: Verdict, lanes: Mapping[str, Lane]) -> str:
    """Return what the verdict rests on."""
    count = verdict.points["n_targets"].iloc[0]
    return f"{count:.0f} mines on {lanes_in_words(lanes)}, halo radius {verdict.rules.halo:g} m."


def verdict_html(
    verdict: Verdict, lanes: Mapping[str, Lane], notes: Mapping[str, Mapping[str, Any]]
) -> str:
    """Return the page of a verdict.

    Parameters
    ----------
    verdict : Verdict
        The verdict.
    lanes : mapping of str to Lane
        Lanes by name.
    notes : mapping of str to mapping
        Provenance by vendor: that of :func:`flgpr.report.trial_block.comparison_block`, and ``rows``, ``signed``,
        ``signed_line`` and ``looks``.

    Returns
    -------
    str
        The page, HTML without references to other files.
    """
    names = list(verdict.points["detector"])
    signatures = []
    for name in names:
        stated = notes[name]
        used, of_all = stated["rows"]
        rows = f"{used} of {of_all}"
        signatures.append([name, rows, stated["signed"], stated["signed_line"], stated["looks"]])
    rules = {
        "halo_radius": verdict.rules.halo,
        "area_rule": verdict.rules.area,
        "level": verdict.rules.level,
    }
    return render(
        "verdict.html",
        "flgpr_trials",
        sentence=verdict.in_words(),
        lead=_lead(verdict, lanes),
        vendors=names,
        roc=_roc(verdict),
        tables=verdict_tables(verdict),
        notes_on_points=_notes_on_points(verdict),
        signatures=signatures,
        trial=comparison_block(names, lanes, rules, notes),
    )


def verdict_pdf(
    verdict: Verdict, lanes: Mapping[str, Lane], notes: Mapping[str, Mapping[str, Any]]
) -> bytes:
    """Return the same as a PDF on A4; the parameters are those of :func:`verdict_html`."""
    names = list(verdict.points["detector"])
    first = notes[names[0]]
    sheets = _Sheets(f"Verdict: {', '.join(names)}", f"scored on {first['scored_on']}")
    sheets.paragraph(verdict.in_words(), size=13, weight="bold")
    sheets.paragraph(_lead(verdict, lanes))
    sheets.picture(_roc(verdict))
    tables = verdict_tables(verdict)
    sheets.table(tables[0])
    for note in _notes_on_points(verdict):
        sheets.paragraph(note, size=7.5)
    for table in tables[1:]:
        sheets.table(table)
    rows = []
    for name in names:
        stated = notes[name]
        used, of_all = stated["rows"]
        rows.append([name, stated["alarms_file"], f"{used} of {of_all}", stated["signed"]])
    sheets.table(PageTable("Lists", ["vendor", "file", ">rows used", "signed by"], rows))
    for name in names:
        sheets.paragraph(f"{name}: SHA-256 {notes[name]['alarms_sha256']}", size=7.5)
    sheets.paragraph(f"Sealed truth: SHA-256 {first['sealed_sha256']}", size=7.5)
    return sheets.data()


class _Sheets:
    """Pages of A4 that are filled from above; what does not fit begins the next page."""

    def __init__(self, title: str, foot: str) -> None:
        self._title = title
        self._foot = foot
        self._pages: list[Figure] = []
        self._next_page()

    def _next_page(self) -> None:
        """Begin a page."""
        page = Figure(figsize=_PAGE)
        number = len(self._pages) + 1
        page.text(_LEFT, 0.975, self._title[:90], fontsize=8, color="0.4")
        page.text(_RIGHT, 0.975, self._foot, fontsize=8, color="0.4", ha="right")
        page.text(_RIGHT, 0.025, f"page {number}", fontsize=8, color="0.4", ha="right")
        self._pages.append(page)
        self._y = _TOP

    def _take(self, height: float) -> float:
        """Return where a part of this height begins, on a new page if need be."""
        if self._y - height < _BOTTOM:
            self._next_page()
        begin = self._y
        self._y -= height
        return begin

    def paragraph(self, text: str, size: float = 9, weight: str = "normal") -> None:
        """Write a paragraph."""
        # A letter of this font is about 0.56 of its size wide, bold ones more.
        letter = 0.6 if weight == "bold" else 0.54
        width = int((_RIGHT - _LEFT) * _PAGE[0] * 72 / (letter * size))
        lines = textwrap.wrap(text, width)
        line = 1.35 * size / 72 / _PAGE[1]
        begin = self._take(line * len(lines) + 0.008)
        for number, words in enumerate(lines):
            place = (_LEFT, begin - line * number)
            self._pages[-1].text(*place, words, fontsize=size, weight=weight, va="top")

    def picture(self, figure: Figure) -> None:
        """Draw a figure across the page."""
        image = imread(io.BytesIO(figure_png(figure, 220)))
        width = _RIGHT - _LEFT
        height = width * _PAGE[0] / _PAGE[1] * image.shape[0] / image.shape[1]
        begin = self._take(height + 0.01)
        axes = self._pages[-1].add_axes((_LEFT, begin - height, width, height))
        axes.imshow(image, aspect="auto", interpolation="none")
        axes.set_axis_off()

    def table(self, table: PageTable) -> None:
        """Draw a table; a long one goes on on the next page."""
        longest = []
        for number, name in enumerate(table.head):
            cells = [name.lstrip(">"), *(str(row[number]) for row in table.rows)]
            longest.append(min(max(map(len, cells)), _MOST_CELL) + 2.5)
        letter = min((_RIGHT - _LEFT) / sum(longest), _LETTER)
        edges = _LEFT + letter * np.cumsum([0.0, *longest])
        size = 8 * letter / _LETTER

        # A short table stands on one page as a whole.
        begin = self._take((min(len(table.rows), _SHORT) + 2.6) * _LINE)
        self._pages[-1].text(_LEFT, begin, table.title, fontsize=10, weight="bold", va="top")
        self._y = begin - 1.5 * _LINE
        is_number = [name.startswith(">") for name in table.head]
        head = [name.lstrip(">") for name in table.head]
        for number, row in enumerate([head, *table.rows]):
            weight = "normal" if number else "bold"
            self._row([str(cell) for cell in row], is_number, edges, size, weight)
        self._y -= 0.012

    def _row(
        self,
        cells: Sequence[str],
        is_number: Sequence[bool],
        edges: FloatArray,
        size: float,
        weight: str,
    ) -> None:
        """Draw a row of a table, and a line under it."""
        begin = self._take(_LINE)
        page = self._pages[-1]
        for number, cell in enumerate(cells):
            place = edges[number + 1] - 0.014 if is_number[number] else edges[number]
            side = "right" if is_number[number] else "left"
            text = cell if len(cell) <= _MOST_CELL else f"{cell[: _MOST_CELL - 1]}…"
            page.text(place, begin, text, fontsize=size, weight=weight, ha=side, va="top")
        line = begin - 0.82 * _LINE
        page.add_artist(Line2D([edges[0], edges[-1]], [line, line], color="0.8", lw=0.5))

    def data(self) -> bytes:
        """Return the PDF, the same bytes for equal pages."""
        stream = io.BytesIO()
        with PdfPages(
            stream, metadata={"CreationDate": None, "Producer": None, "Creator": None}
        ) as pages:
            for page in self._pages:
                show_dollar_signs(page)
                pages.savefig(page)
        return stream.getvalue()
