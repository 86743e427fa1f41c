"""What the pages of the studies share: templates, figures, and Pd at operating points."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd
from matplotlib.figure import Figure

from flgpr.report import figure_png, render
from flgpr.scoring import Match, chance, clopper_pearson, operating_row, roc_of
from flgpr.store.outputs import log_finished
from flgpr.types import Entries
from flgpr_papers.kit.findings import NO_VERDICT, OPEN, VERDICTS, Finding

Rows = Sequence[tuple[str, str, str]]
"""Numbers beside a figure: quantity, what the paper says, and what is here."""


@dataclass(frozen=True)
class Twin:
    """A figure of the paper, drawn from our lanes with the same axes, panels and polarization."""

    number: str  #: of the paper's figure, "Fig. 8"; empty for a figure that the paper does not have
    title: str
    picture: bytes  #: PNG
    caption: str  #: what the panels show, and how they differ from the paper's
    #: what the paper's figure or text says in numbers beside ours
    numbers: Rows = ()

    @property
    def heading(self) -> str:
        """Number and title."""
        return f"{self.number}. {self.title}" if self.number else self.title


def twins(
    captions: Mapping[str, Entries],
    pictures: Mapping[str, bytes],
    findings: Sequence[Finding],
    facts: Entries,
) -> list[Twin]:
    """Return the figures of a study with what ``captions.toml`` says of them, in its order.

    An entry ``draws`` a figure: the name of the function, and what it takes beside what was
    measured. One on the page has ``title`` and ``caption``, and may have ``number`` (of the paper's figure),
    ``numbers`` (rows that stand beside it), and ``claims``: the beginnings of the statements that
    stand there, too, with their quantity if ``quantities`` is set, and of one ``group`` alone.

    Parameters
    ----------
    captions : mapping of str to dict
        The entries by the name of the figure.
    pictures : mapping of str to bytes
        Figures by name, PNG.
    findings : sequence of Finding
        Findings of the study.
    facts : mapping
        What stands for the fields in braces of captions and numbers.
    """
    shown = []
    for name, caption in captions.items():
        if "caption" not in caption:
            continue
        numbers = [
            (quantity.format(**facts), stated, here.format(**facts))
            for quantity, stated, here in caption.get("numbers", ())
        ]
        for finding in findings:
            is_of_group = finding.group == caption.get("group", finding.group)
            if is_of_group and finding.claim.startswith(tuple(caption.get("claims", ()))):
                quantity = f": {finding.quantity}" if "quantities" in caption else ""
                numbers.append((finding.claim + quantity, finding.paper, finding.ours))
        text = caption["caption"].format(**facts)
        number = caption.get("number", "")
        shown.append(Twin(number, caption["title"], pictures[name], text, numbers))
    return shown


def study_html(template: str, **values: Any) -> str:
    """Render a template of ``flgpr_papers/templates`` as a page that needs no other file.

    The page of a paper extends ``paper.html``, which has the order of sections that all share.
    """
    return render(
        template,
        "flgpr_papers",
        verdicts=VERDICTS,
        no_verdict=NO_VERDICT,
        open_question=OPEN,
        **values,
    )


@contextmanager
def log_if_unchanged(path: Path) -> Iterator[None]:
    """Log that a page or table is finished already, if the block leaves its bytes unchanged."""
    before = path.read_bytes() if path.is_file() else None
    yield
    if path.read_bytes() == before:
        log_finished(path)


def draw(figure: Figure, quick: bool, dpi: float = 110) -> bytes:
    """Render a figure as PNG, marked if the run was quick."""
    if quick:
        figure.text(
            0.5,
            0.5,
            "quick run",
            fontsize=34,
            color="#cc0000",
            alpha=0.25,
            rotation=20,
            ha="center",
            va="center",
        )
    return figure_png(figure, dpi)


FAR = (0.01, 0.02, 0.05, 0.1)
"""Operating points that every page shows, false alarms per m²."""
HEADER = ["alarms by", "targets", *(f"Pd at {far:g} per m², 95 %, chance" for far in FAR)]


def detections_at(matched: Match, subset: Any, far: float, **area: Any) -> tuple[int, int, float]:
    """Return the number of targets found at an allowed FAR, of all targets, and Pd by chance.

    Parameters
    ----------
    matched : Match
        Alarms matched to targets.
    subset : object
        Targets that count, as `flgpr.scoring.roc_of` takes them.
    far : float
        Allowed false alarms per m².
    **area
        Rules of the area, as `flgpr.scoring.roc_of` takes them.
    """
    curve = roc_of(matched, subset, **area)
    curve = chance(matched).add_chance_column(curve, subset)
    return _detections_on(curve, far)


def _detections_on(curve: pd.DataFrame, far: float) -> tuple[int, int, float]:
    """Return targets found, all targets and Pd by chance at an allowed FAR of a curve."""
    row = curve.iloc[int(operating_row(curve, far))]
    return int(row["n_detected"]), int(row["n_targets"]), float(row["chance"])


def pd_in_words(n_found: int, targets: int, by_chance: float) -> str:
    """Format a Pd with its counts, exact interval and chance level."""
    low, high = clopper_pearson(n_found, targets)
    share = n_found / max(targets, 1)
    interval = f"{share:.0%} ({low:.0%} to {high:.0%})"
    return f"{n_found} of {targets} = {interval}, chance {by_chance:.0%}"


def point_rows(
    matches: Mapping[str, Match], subsets: Entries, **area: Any
) -> list[tuple[str, ...]]:
    """Tabulate Pd at the operating points: a row per detector and subset of the targets.

    Parameters
    ----------
    matches : mapping of str to Match
        Matched alarms by the name of the detector.
    subsets : mapping of str to object
        Subsets of the targets by name, as `flgpr.scoring.roc_of` takes them.
    **area
        Rules of the area, as `flgpr.scoring.roc_of` takes them.

    Returns
    -------
    list of tuple
        Cells under ``HEADER``.
    """
    rows = []
    for detector, match in matches.items():
        level = chance(match)
        for kind, subset in subsets.items():
            curve = level.add_chance_column(roc_of(match, subset, **area), subset)
            cells = [pd_in_words(*_detections_on(curve, far)) for far in FAR]
            rows.append((detector, kind, *cells))
    return rows
