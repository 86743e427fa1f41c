"""How a proving ground, its data and what enters it are cited, and under which licence."""

from __future__ import annotations

from dataclasses import dataclass

import flgpr
from flgpr_ground.card import Card
from flgpr_ground.ground import GROUNDS, Ground, load_ground

CREATOR = "The flgpr developers"
"""Who made the packaged grounds, as CITATION.cff names them."""
PUBLISHED = {
    "proving-ground-2": "2026-11-23",
    "proving-ground-1": "2026-11-23",
    "full-wave-2": "2026-11-26",
    "full-wave-1": "2026-11-23",
}
"""Days on which the packaged descriptions were committed, before a detector ran on their lanes."""


@dataclass(frozen=True)
class Licence:
    """A licence."""

    name: str  #: identifier of SPDX
    url: str  #: where SPDX shows it, or its own page
    covers: str  #: what is under it


DATA_LICENCE = Licence(
    "CC-BY-4.0",
    "https://creativecommons.org/licenses/by/4.0/",
    "the lanes that the packaged descriptions give, their truth, and scores and tables made of "
    "them",
)
"""Of what the packaged grounds give; as the licence of the software it asks for the names."""
SOFTWARE_LICENCE = Licence(
    "BSD-3-Clause",
    "https://spdx.org/licenses/BSD-3-Clause.html",
    "the software, the descriptions and the full-wave lanes, which are files of the package",
)


def is_packaged(ground: Ground) -> bool:
    """Return whether a ground is one that comes with the package, or its quick form.

    One of somebody else that has the name of a packaged one is none.
    """
    name = ground.title.removesuffix("-quick")
    return name in GROUNDS and load_ground(ground.quick, name).table == ground.table


def licences(ground: Ground) -> list[Licence]:
    """Return the licences of the data of a packaged ground; none for one of somebody else."""
    if not is_packaged(ground):
        return []
    return [DATA_LICENCE, SOFTWARE_LICENCE] if ground.stored_lane_count else [DATA_LICENCE]


def cite_ground(ground: Ground) -> str:
    """Return how a ground is cited, as a line of text."""
    if not is_packaged(ground):
        return f"{ground.title}, a proving ground made with flgpr {flgpr.__version__}."
    year = PUBLISHED[ground.title.removesuffix("-quick")][:4]
    return (
        f"{CREATOR} ({year}): {ground.title}, a proving ground for forward-looking "
        f"ground-penetrating radar, made with flgpr {flgpr.__version__}."
    )


def bibtex_of_ground(ground: Ground) -> str:
    """Return how a packaged ground is cited, as an entry of BibTeX."""
    year = PUBLISHED[ground.title.removesuffix("-quick")][:4]
    key = ground.title.replace("-", "")
    return (
        f"@misc{{{key}, author = {{{{{CREATOR}}}}}, year = {{{year}}}, "
        f"title = {{{ground.title}: a proving ground for forward-looking ground-penetrating "
        f"radar}}, note = {{made with flgpr {flgpr.__version__}}}}}"
    )


def cite_submission(card: Card) -> str:
    """Return how a submission is cited, as a line of text."""
    authors = ", ".join(card.authors)
    text = f"{authors} ({card.date.year}): {card.name}, version {card.version}, on {card.ground}."
    return f"{text} {card.reference}" if card.reference else text
