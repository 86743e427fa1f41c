"""Self-contained HTML pages: style, pictures and tables."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

_STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; color: #1d232b; background: #fff; max-width: 1080px; margin: 2rem auto; padding: 0 1rem; }
h1 { font-size: 1.6rem; margin-bottom: .2rem; } h2 { font-size: 1.2rem; margin-top: 2.2rem; border-bottom: 1px solid #ccd3dc; }
p.lead { color: #4a5563; margin-top: 0; } img { max-width: 100%; height: auto; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; font-size: 14px; margin: .6rem 0; }
th, td { padding: .2rem .7rem; border-bottom: 1px solid #e3e7ec; text-align: right; vertical-align: top; }
td { white-space: nowrap; } th { background: #f3f5f8; } td.t, th.t { text-align: left; } .scroll { overflow-x: auto; }
pre { background: #f3f5f8; padding: .8rem; overflow-x: auto; font-size: 13px; } .note { color: #4a5563; }
@media (max-width: 700px) { table { display: block; overflow-x: auto; } td.t { white-space: normal; } code { overflow-wrap: anywhere; } }
"""


def html_page(title: str, parts: Sequence[str], style: str = _STYLE) -> str:
    """Put a page together.

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
    return (
        f'<!doctype html><html lang="en"><head><meta charset="utf-8"><title>{escape(title)}</title>'
        f'<meta name="viewport" content="width=device-width"><style>{style}</style></head><body>'
        + "\n".join(parts)
        + "</body></html>\n"
    )


def html_image(url: str, text: str) -> str:
    """Write a picture.

    Parameters
    ----------
    url : str
        Data URL.
    text : str
        What it shows, for those who cannot see it.

    Returns
    -------
    str
        HTML.
    """
    return f'<p><img src="{url}" alt="{escape(text)}"></p>'


def html_table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Write a table.

    Parameters
    ----------
    head : sequence of str
        Titles of the columns; one with a leading star holds text, the others numbers.
    rows : sequence of sequence of str
        Cells, plain text.

    Returns
    -------
    str
        HTML.
    """
    classes = [" class=t" if name.startswith("*") else "" for name in head]
    cells = "".join(f"<th{kind}>{escape(name.lstrip('*'))}</th>" for name, kind in zip(head, classes, strict=True))
    body = "".join(
        "<tr>" + "".join(f"<td{k}>{escape(str(v))}</td>" for v, k in zip(row, classes, strict=True)) + "</tr>"
        for row in rows
    )
    return f"<div class=scroll><table><thead><tr>{cells}</tr></thead><tbody>{body}</tbody></table></div>"
