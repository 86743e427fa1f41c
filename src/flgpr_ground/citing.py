"""How a proving ground, its data and what enters it are cited, and under which licence."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import pandas as pd

import flgpr
from flgpr.scoring import paired_interval
from flgpr_ground.card import Card
from flgpr_ground.entries import packaged_entries
from flgpr_ground.ground import GROUNDS, Ground, by_pd, load_ground, scores_at

CREATOR = "The flgpr developers"
"""Who made the packaged grounds, as CITATION.cff names them."""
PUBLISHED = {
    "proving-ground-2": "2026-11-23",
    "proving-ground-1": "2026-11-23",
    "full-wave-2": "2026-11-26",
    "full-wave-1": "2026-11-23",
}
"""Days on which the packaged descriptions were committed, before a detector ran on their lanes."""


WANG2007 = """\
@article{wang2007, author = {Wang, Tsaipei and Keller, James M. and Gader, Paul D. and Sjahputera, Ozy},
  title = {Frequency Subband Processing and Feature Analysis of Forward-Looking Ground-Penetrating Radar
    Signals for Land-Mine Detection},
  journal = {IEEE Transactions on Geoscience and Remote Sensing}, volume = {45}, number = {3},
  year = {2007}, doi = {10.1109/TGRS.2006.888142}}"""
"""BibTeX of the paper whose C_HH is the reference of the packaged grounds."""


class Licence(NamedTuple):
    """A licence."""

    name: str  #: identifier of SPDX
    covers: str  #: what is under it


DATA_LICENCE = Licence(
    "CC-BY-4.0",
    "the lanes that the packaged descriptions give, their truth, and scores and tables made of "
    "them",
)
"""Of what the packaged grounds give; as the licence of the software it asks for the names."""


def is_packaged(ground: Ground) -> bool:
    """Return whether a ground is one that comes with the package, or its quick form.

    One of somebody else that has the name of a packaged one is none.
    """
    name = ground.title.removesuffix("-quick")
    return name in GROUNDS and load_ground(ground.quick, name).table == ground.table


def cite_ground(ground: Ground) -> str:
    """Return how a ground is cited, as a line of text."""
    if not is_packaged(ground):
        return f"{ground.title}, a proving ground made with flgpr {flgpr.__version__}."
    return (
        f"{CREATOR} ({_year(ground)}): {ground.title}, a proving ground for forward-looking "
        f"ground-penetrating radar, made with flgpr {flgpr.__version__}."
    )


def bibtex_of_ground(ground: Ground) -> str:
    """Return how a packaged ground is cited, as an entry of BibTeX."""
    key = ground.title.replace("-", "")
    return (
        f"@misc{{{key}, author = {{{{{CREATOR}}}}}, year = {{{_year(ground)}}}, "
        f"title = {{{ground.title}: a proving ground for forward-looking ground-penetrating "
        f"radar}}, note = {{made with flgpr {flgpr.__version__}}}}}"
    )


def _year(ground: Ground) -> str:
    """Return the year in which a packaged ground was published."""
    return PUBLISHED[ground.title.removesuffix("-quick")][:4]


def bibtex(ground: Ground) -> str:
    """Return the entries of BibTeX for the software, the ground and the method of its reference."""
    software = (
        f"@software{{flgpr, author = {{{{{CREATOR}}}}}, version = {{{flgpr.__version__}}}, "
        "title = {flgpr: forward-looking ground-penetrating radar, end to end}}"
    )
    entries = [software, bibtex_of_ground(ground)] if is_packaged(ground) else [software]
    return "\n\n".join([*entries, WANG2007]) + "\n"


def latex_table(ground: Ground, scores: pd.DataFrame, split: str) -> str:
    """Return a table of booktabs: Pd, counts, chance and difference from the reference by entry.

    Parameters
    ----------
    ground : Ground
        The ground with all of its tiers.
    scores : pandas.DataFrame
        What :func:`flgpr_ground.table.score_entries` returns.
    split : str
        Name of the split.

    Returns
    -------
    str
        LaTeX text: an environment ``tabular``, and comments that say what is in it.
    """
    reference = ground.table.reference
    if reference in packaged_entries(ground):
        reference += f", {packaged_entries(ground)[reference].title}"
    lines = [
        f"% {cite_ground(ground)} Split {split}; \\usepackage{{booktabs}}.",
        f"% Pd of mines at {ground.table.far:g} false alarms per m^2, exact 95 % intervals; chance: "
        "Pd of alarms that know nothing of the mines;",
        f"% difference from {reference}: Tango's 95 % interval, p of McNemar's exact test.",
        "\\begin{tabular}{lrrrrrr}",
        "\\toprule",
        "detector & $P_d$ & found & false & chance & difference & $p$ \\\\",
    ]
    for tier in ground.chosen_tiers():
        of_tier = scores_at(scores, tier, split)
        if len(of_tier):
            lines += ["\\midrule", *_latex_rows(of_tier, tier.tier_title)]
    return "\n".join([*lines, "\\bottomrule", "\\end{tabular}"]) + "\n"


def _latex_rows(scores: pd.DataFrame, title: str) -> Iterator[str]:
    """Yield the rows of a tier, the largest Pd first."""
    if title:
        yield f"\\multicolumn{{7}}{{l}}{{\\emph{{{_latex(title)}}}}} \\\\"
    for row in by_pd(scores).to_dict("records"):
        paired = ["--", "--"]
        if np.isfinite(row.get("p", np.nan)):
            only, other, total = row["only"], row["reference_only"], row["n_targets"]
            low, high = paired_interval(only, other, total)
            paired = [f"${(only - other) / total:+.2f}$ (${low:+.2f}$ to ${high:+.2f}$)"]
            paired.append(f"{row['p']:.2g}")
        cells = [
            _latex(str(row["entry"])),
            f"{row['pd']:.2f} ({row['pd_low']:.2f} to {row['pd_high']:.2f})",
            f"{row['n_detected']:.0f} of {row['n_targets']:.0f}",
            f"{row['n_false']:.0f}",
            f"{row['chance']:.2f}",
            *paired,
        ]
        yield " & ".join(cells) + " \\\\"


def _latex(text: str) -> str:
    """Return text with the characters escaped that LaTeX would take as its own."""
    escaped = text.replace("\\", "\\textbackslash ")
    for letter in "&%$#_{}":
        escaped = escaped.replace(letter, f"\\{letter}")
    return escaped.replace("~", "\\textasciitilde ").replace("^", "\\textasciicircum ")


def cite_submission(card: Card) -> str:
    """Return how a submission is cited, as a line of text."""
    authors = ", ".join(card.authors)
    text = f"{authors} ({card.date.year}): {card.name}, version {card.version}, on {card.ground}."
    return f"{text} {card.reference}" if card.reference else text
