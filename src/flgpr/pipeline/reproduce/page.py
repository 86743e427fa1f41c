"""What the pages of the papers share: style, tables and the table of findings."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from typing import Any

from flgpr.pipeline.html import html_page
from flgpr.pipeline.reproduce.findings import AGREES, DISAGREES, UNDECIDED, Finding

_STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; color: #1d232b; max-width: 1100px; margin: 2rem auto; padding: 0 1rem; }
h1 { font-size: 1.6rem; } h2 { font-size: 1.2rem; margin-top: 2.2rem; border-bottom: 1px solid #ccd3dc; }
img { max-width: 100%; height: auto; } figure { margin: 1.2rem 0; } figcaption { color: #4a5563; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; font-size: 13px; margin: .6rem 0; }
th, td { padding: .2rem .55rem; border-bottom: 1px solid #e3e7ec; text-align: left; vertical-align: top; }
th { background: #f3f5f8; } .agrees { color: #006b3f; } .disagrees { color: #b3261e; } .undecided { color: #7a5b00; }
.quick { background: #fde7e7; border: 1px solid #b3261e; padding: .6rem; } .scroll { overflow-x: auto; }
@media (max-width: 700px) { table { display: block; overflow-x: auto; } }
"""


def study_html(title: str, parts: Sequence[str], style: str = _STYLE) -> str:
    """Put the page of a paper together.

    Parameters
    ----------
    title : str
        Plain text.
    parts : sequence of str
        HTML of the body.
    style : str
        CSS.

    Returns
    -------
    str
        HTML that needs nothing beside it.
    """
    return html_page(title, parts, style)


def plain_table(head: Sequence[str], rows: Sequence[Sequence[Any]]) -> str:
    """Write a table of plain text.

    Parameters
    ----------
    head : sequence of str
        Titles of the columns.
    rows : sequence of sequence
        Cells.

    Returns
    -------
    str
        HTML.
    """
    top = "".join(f"<th>{escape(cell)}</th>" for cell in head)
    body = "".join("<tr>" + "".join(f"<td>{escape(str(cell))}</td>" for cell in row) + "</tr>" for row in rows)
    return f"<table><tr>{top}</tr>{body}</table>"


def wide_table(head: Sequence[str], rows: Sequence[Sequence[Any]]) -> str:
    """Write a table that scrolls sideways where the page is too narrow for it.

    Parameters
    ----------
    head : sequence of str
        Titles of the columns.
    rows : sequence of sequence
        Cells.

    Returns
    -------
    str
        HTML.
    """
    return f"<div class=scroll>{plain_table(head, rows)}</div>"


def findings_table(found: Sequence[Finding], rules: str) -> str:
    """Write the findings beneath the count of their verdicts.

    Parameters
    ----------
    found : sequence of Finding
        The findings.
    rules : str
        HTML that tells by which rules they were judged.

    Returns
    -------
    str
        HTML.
    """
    rows = "".join(
        f"<tr><td>{escape(one.claim)}</td><td>{escape(one.paper)}</td><td>{escape(one.ours)}</td>"
        f"<td class={one.verdict}><b>{one.verdict}</b></td><td>{escape(one.note)}</td></tr>"
        for one in found
    )
    text = ", ".join(f"{sum(one.verdict == word for one in found)} {word}" for word in (AGREES, DISAGREES, UNDECIDED))
    return (
        f"<p>{text}. {rules}</p><div class=scroll><table><tr><th>finding</th><th>paper</th><th>here</th>"
        f"<th>verdict</th><th>remark</th></tr>{rows}</table></div>"
    )
