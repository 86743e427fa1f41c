"""The table of the papers: how each is run again, and where its verdicts stand afterwards."""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path

import flgpr
from flgpr.io import write_whole
from flgpr.pipeline.progress import Track, silent
from flgpr.pipeline.reproduce import cosgrove2004, flsar2004, fuse2018, wang2007
from flgpr.pipeline.reproduce.page import study_html

VERDICTS = ("agrees", "disagrees", "cannot say")
_WORDS = {"holds": "agrees", "fails": "disagrees", "undecided": "cannot say"} | {one: one for one in VERDICTS}
_STYLE = """
:root { color-scheme: light dark; --line: #ccd3dc; --head: #f3f5f8; --good: #006b3f; --bad: #b3261e; --open: #7a5b00; }
@media (prefers-color-scheme: dark) {
  :root { --line: #3a4350; --head: #222a33; --good: #5fd39b; --bad: #ff8a80; --open: #e5c15a; } }
body { font: 15px/1.5 system-ui, sans-serif; max-width: 1100px; margin: 2rem auto; padding: 0 1rem; }
h1 { font-size: 1.6rem; } h2 { font-size: 1.2rem; margin-top: 2.2rem; border-bottom: 1px solid var(--line); }
table { border-collapse: collapse; font-size: 14px; margin: .6rem 0; }
th, td { padding: .25rem .7rem; border-bottom: 1px solid var(--line); text-align: left; vertical-align: top; }
th { background: var(--head); } td.n { text-align: right; font-variant-numeric: tabular-nums; }
td.agrees, td.disagrees, td.cannot { white-space: nowrap; }
td.agrees { color: var(--good); } td.disagrees { color: var(--bad); } td.cannot { color: var(--open); }
.quick { border: 1px solid var(--bad); padding: .6rem; } .scroll { overflow-x: auto; }
"""


@dataclass(frozen=True)
class Verdict:
    """One statement of a paper and what the simulated lanes say of it.

    Attributes
    ----------
    claim : str
        What the paper says.
    ours : str
        Our figure with its interval.
    verdict : {"agrees", "disagrees", "cannot say"}
        By the rules of the paper's own page.
    """

    claim: str
    ours: str
    verdict: str


@dataclass(frozen=True)
class Paper:
    """How one paper is run again.

    Attributes
    ----------
    title : str
        Authors, year and subject.
    run : callable
        Takes the folder to work in, whether to be quick, and a ``Track``; returns the page.
    verdicts : callable
        Takes that folder and returns what the paper's findings file holds.
    """

    title: str
    run: Callable[[Path, bool, Track], Path]
    verdicts: Callable[[Path], list[Verdict]]


def verdict_of(word: str) -> str:
    """Translate a page's word for a verdict into that of the overview.

    Parameters
    ----------
    word : str
        "agrees", "disagrees", "cannot say", or "holds", "fails", "undecided".

    Returns
    -------
    str
        One of `VERDICTS`.

    Raises
    ------
    ValueError
        If the word is none of these.
    """
    if word not in _WORDS:
        raise ValueError(f"verdict must be one of {', '.join(_WORDS)}, got {word!r}")
    return _WORDS[word]


def _with_interval(value: float | None, low: float | None, high: float | None) -> str:
    if value is None:
        return "nothing to measure"
    if low is None or high is None:
        return f"{value:.3g} (one sample, no interval)"
    if not high > low:
        return f"{value:.3g} ({low:.3g} to {high:.3g})"
    digits = max(0, 1 - math.floor(math.log10(high - low)))  # as many as the interval's width has meaning for
    return f"{value:.{digits}f} ({low:.{digits}f} to {high:.{digits}f})"


def _cosgrove2004(folder: Path) -> list[Verdict]:
    worlds = json.loads((folder / "findings.json").read_text("utf-8"))["findings"]
    return [
        Verdict(
            f"{one['statement']} ({one['quantity']}; {world} lanes)",
            _with_interval(one["mean"], one["low"], one["high"]),
            verdict_of(one["verdict"]),
        )
        for world, found in worlds.items()
        for one in found
        if one["verdict"] != "open"
    ]


def _flsar2004(folder: Path) -> list[Verdict]:
    with (folder / "findings.csv").open(encoding="utf-8", newline="") as lines:
        return [
            Verdict(
                f"{row['name']} ({row['quantity']})",
                _with_interval(float(row["value"]), float(row["low"]), float(row["high"])),
                verdict_of(row["verdict"]),
            )
            for row in csv.DictReader(lines)
        ]


def _claims(folder: Path) -> list[Verdict]:
    found = json.loads((folder / "findings.json").read_text("utf-8"))["findings"]
    return [Verdict(f"{one['claim']} ({one['paper']})", one["ours"], verdict_of(one["verdict"])) for one in found]


PAPERS = {
    "cosgrove2004": Paper(
        "Cosgrove, Milanfar & Kositsky 2004: trained detection by deflection", cosgrove2004.reproduce, _cosgrove2004
    ),
    "flsar2004": Paper(
        "flsar2004: prescreeners, templates and relevance vector machines", flsar2004.reproduce, _flsar2004
    ),
    "fuse2018": Paper(
        "Fuse, Gonzalez-Valdes, Martinez-Lorenzo & Rappaport 2018: model-based clutter suppression",
        fuse2018.reproduce,
        _claims,
    ),
    "wang2007": Paper("Wang, Keller, Gader & Sjahputera 2007: sub-bands and ten features", wang2007.reproduce, _claims),
}
"""Every paper that can be run again, by name."""


def reproduce_all(output: str | Path, quick: bool = False, track: Track = silent) -> Path:
    """Run every paper again, each in a folder of its own, and write the overview.

    The overview is written anew after every paper, so that a run that was stopped shows what is there; the papers go on
    where they were.

    Parameters
    ----------
    output : str or Path
        Folder to work in; gets ``index.html`` and ``verdicts.csv``.
    quick : bool
        Small versions that only show that everything runs; the overview says so.
    track : Track
        Shows progress.

    Returns
    -------
    Path
        The overview.
    """
    folder = Path(output)
    folder.mkdir(parents=True, exist_ok=True)
    done: dict[str, tuple[Path, list[Verdict]]] = {}
    overview = folder / "index.html"
    for name, paper in PAPERS.items():
        page = paper.run(folder / name, quick, track)
        done[name] = page.relative_to(folder), paper.verdicts(folder / name)
        write_whole(folder / "verdicts.csv", verdicts_csv({key: found for key, (_, found) in done.items()}))
        write_whole(overview, overview_html(done, quick))
    return overview


def verdicts_csv(found: dict[str, list[Verdict]]) -> str:
    """Tabulate the verdicts of all papers.

    Parameters
    ----------
    found : dict of str to list of Verdict
        By paper.

    Returns
    -------
    str
        CSV with the columns paper, claim, ours, verdict.
    """
    rows = [("paper", "claim", "ours", "verdict")]
    rows += [(name, one.claim, one.ours, one.verdict) for name, verdicts in found.items() for one in verdicts]
    return "".join(",".join('"' + cell.replace('"', '""') + '"' for cell in row) + "\n" for row in rows)


def overview_html(done: dict[str, tuple[Path, list[Verdict]]], quick: bool) -> str:
    """Write the overview: how many statements of each paper agree, disagree or stay open, and then each of them.

    Parameters
    ----------
    done : dict
        By paper, the page relative to the overview and the verdicts. A paper that is missing is still to be run.
    quick : bool
        Whether the runs were small.

    Returns
    -------
    str
        HTML that needs nothing beside it but the papers' pages.
    """
    rows = []
    for name, paper in PAPERS.items():
        if name in done:
            page, found = done[name]
            cells = f'<td><a href="{escape(page.as_posix())}">{name}</a></td><td>{escape(paper.title)}</td>' + "".join(
                f"<td class=n>{sum(one.verdict == word for one in found)}</td>" for word in VERDICTS
            )
        else:
            cells = f"<td>{name}</td><td>{escape(paper.title)}</td><td colspan=3>still to be run</td>"
        rows.append(f"<tr>{cells}</tr>")
    head = "".join(f"<th>{word}</th>" for word in ("paper", "about", *VERDICTS))
    note = (
        "<p class=quick><b>Quick run.</b> It shows that everything runs. Its verdicts say nothing about the papers.</p>"
        if quick
        else ""
    )
    parts = [
        "<h1>The papers, run again on simulated lanes</h1>",
        note,
        f"<p>flgpr {escape(flgpr.__version__)}. Each statement of a paper is judged by the 95 % interval of ours and a "
        "rule that its own page tells; <i>cannot say</i> means that the interval allows both.</p>",
        f"<div class=scroll><table><tr>{head}</tr>{''.join(rows)}</table></div>",
        *(_verdict_table(name, found) for name, (_, found) in done.items()),
    ]
    return study_html("flgpr: papers reproduced", parts, _STYLE)


def _verdict_table(name: str, found: Sequence[Verdict]) -> str:
    rows = "".join(
        f"<tr><td>{escape(one.claim)}</td><td>{escape(one.ours)}</td>"
        f"<td class={one.verdict.split()[0]}>{one.verdict}</td></tr>"
        for one in found
    )
    head = "<tr><th>statement</th><th>here</th><th>verdict</th></tr>"
    return f"<h2>{name}</h2><div class=scroll><table>{head}{rows}</table></div>"
