"""What published standards ask of a test of detectors, and what a score's report holds of it.

Not all documents could be read. :data:`SOURCES` says what was read of each; an item cites only what
was read, and no clause by its number.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True)
class Source:
    """A document, and what of it this checklist rests on."""

    key: str  #: how items cite it
    document: str  #: title, number and year
    read: str  #: what was read of it


@dataclass(frozen=True)
class Item:
    """Something that a test of detectors should state."""

    topic: str
    asked: str  #: what is asked for, in our own words
    sources: tuple[str, ...]  #: keys of the sources
    covered: Literal["yes", "partly", "no"]  #: by the report of a score
    where: str  #: where the report has it, or who must add it


SOURCES = (
    Source(
        "CWA 14747-1",
        "CEN Workshop Agreement 14747-1:2003, Humanitarian mine action, test and evaluation, "
        "metal detectors",
        "Not the document: accounts of it by its authors and by the trials that used it "
        "(Bloodworth and Sieber, Journal of Mine Action 7.3, 2003; Müller and others, Journal of "
        "Mine Action 8.2, 2004; the abstract of Reliability Tests for Demining, e-Journal of NDT "
        "11.3, 2006). It is written for metal detectors; what it asks of blind field tests "
        "carries over to a radar.",
    ),
    Source(
        "CWA 14747-2",
        "CEN Workshop Agreement 14747-2:2008, soil characterisation for metal detector and "
        "ground-penetrating radar performance",
        "Its title alone.",
    ),
    Source(
        "IMAS 03.40",
        "International Mine Action Standard 03.40, test and evaluation of mine action equipment",
        "Its title page and foreword. Its clauses could not be read: no item cites it.",
    ),
    Source(
        "Yvinec 2017",
        "Yvinec, Testing and evaluating results of research in mine action, in: Mine Action, "
        "IntechOpen 2017, doi 10.5772/65780",
        "The abstract.",
    ),
    Source(
        "practice",
        "No document: what a reader of a trial's report needs, as this project takes it",
        "Nothing: assumed.",
    ),
)

ITEMS = (
    Item(
        "Objective",
        "what is to be measured, fixed before the test",
        ("Yvinec 2017",),
        "partly",
        "a planned truth fixes lanes, halo and rate in its register; what the test is for must be "
        "added by hand",
    ),
    Item(
        "System under test",
        "vendor, system and version",
        ("practice",),
        "partly",
        "the head has vendor, file and digest; hardware and version of a vendor's system must be "
        "added by hand",
    ),
    Item(
        "Blind test",
        "whoever operates and evaluates does not know where the targets are",
        ("CWA 14747-1", "Yvinec 2017"),
        "yes",
        "a sealed truth whose looks are counted; recipes that are registered before the truth is "
        "opened",
    ),
    Item(
        "Targets",
        "realistic targets at known depths, enough of them for statistics",
        ("CWA 14747-1",),
        "yes",
        "counts by kind and depth; flgpr plan size computes how many are needed",
    ),
    Item(
        "Detections and false alarms",
        "share of targets found, and false alarms per m², drawn together",
        ("CWA 14747-1",),
        "yes",
        "ROC curves, several systems in one figure, with the level of chance",
    ),
    Item(
        "Confidence intervals",
        "how far the numbers of targets and of m² carry",
        ("practice",),
        "yes",
        "exact intervals of both rates at every point, paired intervals of differences",
    ),
    Item(
        "What counts as found",
        "how near an alarm must be to a target, and which area false alarms are counted on",
        ("practice",),
        "yes",
        "halo radius and area rule, in the head and in the JSON",
    ),
    Item(
        "Soil",
        "the soil of the site, measured",
        ("CWA 14747-2", "CWA 14747-1"),
        "no",
        "the test team adds permittivity, moisture, texture and roughness; a simulated lane has "
        "them in its scene",
    ),
    Item(
        "Ground and conditions",
        "terrain representative of the areas to be cleared, local conditions",
        ("CWA 14747-1",),
        "no",
        "the test team adds terrain, vegetation, weather and disturbance by metal or radio",
    ),
    Item(
        "Operators",
        "local personnel, their training and experience; what people contribute to the result",
        ("CWA 14747-1",),
        "no",
        "the test team adds them; flgpr agree compares analysts",
    ),
    Item(
        "Repetition",
        "several passes, days and operators over the same lanes",
        ("practice",),
        "partly",
        "several lists are compared target by target; one report is of one pass",
    ),
    Item(
        "Capability in air and in soil",
        "greatest height or depth at which a defined target is detected, under laboratory control",
        ("CWA 14747-1",),
        "no",
        "no measurement on lanes; flgpr design predicts the signal to clutter by depth",
    ),
    Item(
        "Endurance, handling and safety",
        "moisture, shock, temperature, power, ergonomics",
        ("practice",),
        "no",
        "outside what recorded data can show",
    ),
    Item(
        "Record",
        "a report from which the score can be repeated and checked",
        ("practice",),
        "yes",
        "digests of all inputs, rules and version; the same score again gives the same files",
    ),
)


def checklist_rows() -> list[list[str]]:
    """Return the rows of the checklist: topic, asked for, sources, covered, where."""
    rows = []
    for item in ITEMS:
        rows.append([item.topic, item.asked, "; ".join(item.sources), item.covered, item.where])
    return rows


def source_rows() -> list[list[str]]:
    """Return the rows of the table of sources: key, document, what was read of it."""
    return [[source.key, source.document, source.read] for source in SOURCES]
