"""What the pages of the studies share: style, tables, figures and the table of findings."""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Sequence
from html import escape
from typing import Any

from matplotlib.figure import Figure

from flgpr.pipeline.html import html_page
from flgpr.scoring import figure_bytes
from flgpr_papers.kit.findings import VERDICTS, Finding

_STYLE = """
:root { color-scheme: light dark; --line: #ccd3dc; --head: #f3f5f8; --good: #006b3f; --bad: #b3261e; --open: #7a5b00; }
@media (prefers-color-scheme: dark) {
  :root { --line: #3a4350; --head: #222a33; --good: #5fd39b; --bad: #ff8a80; --open: #e5c15a; } }
body { font: 15px/1.5 system-ui, sans-serif; max-width: 1100px; margin: 2rem auto; padding: 0 1rem; }
h1 { font-size: 1.6rem; } h2 { font-size: 1.2rem; margin-top: 2.2rem; border-bottom: 1px solid var(--line); }
img { max-width: 100%; height: auto; background: white; }
figure { margin: 1.2rem 0; } figcaption, .note { opacity: .8; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; font-size: 13px; margin: .6rem 0; }
th, td { padding: .2rem .55rem; border-bottom: 1px solid var(--line); text-align: left; vertical-align: top; }
th { background: var(--head); } .agrees { color: var(--good); } .disagrees { color: var(--bad); }
.cannot { color: var(--open); } td.agrees, td.disagrees, td.cannot { white-space: nowrap; }
.quick { border: 1px solid var(--bad); padding: .6rem; } .scroll { overflow-x: auto; }
"""


def study_html(title: str, parts: Sequence[str]) -> str:
    """Put the page of a study together; it needs nothing beside it. ``title`` is plain text, ``parts`` are HTML."""
    return html_page(title, parts, _STYLE)


def quick_note(quick: bool, small: str) -> str:
    """Say that a run was quick: what was ``small`` in it."""
    if not quick:
        return ""
    return (
        f"<p class=quick><b>Quick run.</b> {small}: this page shows that everything runs. "
        "Its figures say nothing about the paper's findings.</p>"
    )


def plain_table(head: Sequence[str], rows: Sequence[Sequence[Any]]) -> str:
    """Write a table of plain text."""
    top = "".join(f"<th>{escape(cell)}</th>" for cell in head)
    body = "".join("<tr>" + "".join(f"<td>{escape(str(cell))}</td>" for cell in row) + "</tr>" for row in rows)
    return f"<table><tr>{top}</tr>{body}</table>"


def wide_table(head: Sequence[str], rows: Sequence[Sequence[Any]]) -> str:
    """Write a table that scrolls sideways where the page is too narrow for it."""
    return f"<div class=scroll>{plain_table(head, rows)}</div>"


def bullets(told: Sequence[str]) -> str:
    """Write a list of plain sentences."""
    return f"<ul>{''.join(f'<li>{escape(one)}</li>' for one in told)}</ul>"


def findings_table(found: Sequence[Finding], rules: str = "") -> str:
    """Write the findings beneath the count of their verdicts and the HTML that tells by which rules they were judged.

    A column that is empty in all of them is left out.
    """
    cells = {
        "finding": [one.claim for one in found],
        "paper": [one.paper for one in found],
        "number": [one.quantity for one in found],
        "here (95 %)": [one.ours for one in found],
        "rule": ["" if one.rule is None else f"{one.rule[0]:g} to {one.rule[1]:g}" for one in found],
        "verdict": [one.verdict for one in found],
        "remark": [one.note for one in found],
    }
    shown = {name: column for name, column in cells.items() if any(column)}
    rows = "".join(f"<tr>{''.join(map(_cell, shown, row))}</tr>" for row in zip(*shown.values(), strict=True))
    count = ", ".join(f"{sum(one.verdict == word for one in found)} {word}" for word in VERDICTS)
    head = "".join(f"<th>{name}</th>" for name in shown)
    said = f"<p>{count}. {rules}</p>" if rules else ""
    return f"{said}<div class=scroll><table><tr>{head}</tr>{rows}</table></div>"


def _cell(name: str, text: str) -> str:
    if name == "verdict":
        return f"<td class={text.split()[0]}><b>{text}</b></td>"
    return f"<td>{escape(text)}</td>"


def draw(figure: Figure, quick: bool, dpi: float = 110) -> bytes:
    """Render a figure as PNG, marked if the run was quick."""
    if quick:
        figure.text(
            0.5, 0.5, "quick run", fontsize=34, color="#cc0000", alpha=0.25, rotation=20, ha="center", va="center"
        )
    figure.set_dpi(dpi)
    return figure_bytes(figure)


def figure_html(picture: bytes, caption: str, short: str = "") -> str:
    """Write a picture (PNG) with its caption; ``short`` is read to those who cannot see it."""
    source = f"data:image/png;base64,{b64encode(picture).decode()}"
    text = escape(caption)
    return f'<figure><img src="{source}" alt="{escape(short) or text}"><figcaption>{text}</figcaption></figure>'
