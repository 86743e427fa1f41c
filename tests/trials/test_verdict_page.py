"""The pages of a verdict begin with it, and the PDF says the same."""

import re

import pytest

from flgpr_trials.verdict_page import PageTable, _Sheets, verdict_html, verdict_pdf
from judged import LANE, judged


@pytest.fixture(scope="module")
def verdict():
    return judged({"ACME <b>": 24, "Glo$bex$": 21})


def noted(verdict):
    note = {"rows": [24, 25], "signed": "A. Director", "signed_line": 3, "looks": 1}
    note |= {"alarms_sha256": "ab", "sealed_sha256": "cd", "scored_on": "2026-11-29"}
    return {name: note | {"vendor": name, "alarms_file": "a.csv"} for name in verdict.curves}


def test_the_page_begins_with_the_verdict(verdict):
    page = verdict_html(verdict, {"": LANE}, noted(verdict))
    body = page.split("<h1>")[1]
    assert body.startswith(
        "At the registered 0.05 per m²: ACME &lt;b&gt; 24 of 31, Glo$bex$ 21 of 31"
    )
    for words in ("24 of 25", "By kind", "By depth", "Vendors against each other"):
        assert words in page
    text = re.sub(r'src="data:[^"]*"', "", body)
    assert not [
        mark for mark in ("{&#39;", "[&#39;", "np.", "dtype", ">nan", "None") if mark in text
    ]


@pytest.mark.slow("draws a PDF")
def test_the_pdf_has_the_same_bytes_again(verdict):
    pdf = verdict_pdf(verdict, {"": LANE}, noted(verdict))
    assert pdf[:5] == b"%PDF-"
    assert pdf.count(b"/Type /Page ") == 2
    assert pdf == verdict_pdf(verdict, {"": LANE}, noted(verdict))


def test_a_long_table_goes_on_on_the_next_page():
    sheets = _Sheets("Verdict", "")
    sheets.table(PageTable("By lane", ["lane", ">Pd"], [[str(n), "0.5"] for n in range(150)]))
    assert len(sheets._pages) == 3
