"""The head of a score page: what was scored, by whom, when, on which lane, by which rules.

The same stands in the margins of every printed page.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from flgpr.model import Lane
from flgpr.scoring import Score

_DIGEST = 12  # first digits of a digest in a margin; the head has all
_MOST_LANES = 3  # that are described one by one
NOT_STATED = "not stated"


@dataclass(frozen=True)
class TrialBlock:
    """Head of a page, and the margins of its printed pages."""

    rows: list[tuple[str, str]]  #: what, and in words
    head: list[str] = field(default_factory=list)  #: titles of the table of lists, if several
    lists: list[list[str]] = field(default_factory=list)  #: a row for each of several lists
    #: top_left, top_right, bottom_left: margins of a printed page
    top_left: str = ""
    top_right: str = ""
    bottom_left: str = ""


def score_block(main: Score, notes: Mapping[str, Any], title: str) -> TrialBlock:
    """Return the head of the page of a score.

    Parameters
    ----------
    main : Score
        The score.
    notes : mapping
        Provenance: ``vendor``, ``alarms_file``, ``alarms_sha256``, ``truth_sha256``, ``scored_on``
        and ``ranking``; what is missing is said to be not stated.
    title : str
        What was scored, where no file is stated.

    Returns
    -------
    TrialBlock
        The head.
    """
    matched = main.matched
    attrs = main.curve.attrs
    rules = (
        f"halo radius {attrs['halo_radius']:g} m, area rule {attrs['area_rule']}, targets found at "
        f"{main.far:.2g} false alarms per m², {100 * main.rules.level:g} % intervals, refraction "
        f"correction {attrs['refraction']}"
    )
    counts = (len(matched.alarms), len(matched.truth))
    lane = lanes_in_words(matched.lanes)
    return list_block(notes, title, counts, notes.get("truth_sha256"), lane, rules)


def list_block(
    notes: Mapping[str, Any],
    title: str,
    counts: tuple[int, int],
    truth_digest: Any,
    lane: str,
    rules: str,
    margin: str = "",
) -> TrialBlock:
    """Return the head of the page of one alarm list.

    Parameters
    ----------
    notes : mapping
        Provenance, as for :func:`score_block`.
    title : str
        What was scored, where no file is stated.
    counts : (int, int)
        Numbers of alarms and of targets.
    truth_digest : str or None
        SHA-256 of the truth, open or sealed.
    lane, rules : str
        Lane and rules in words.
    margin : str
        The lane in the margin, where it has other words there.

    Returns
    -------
    TrialBlock
        The head.
    """
    alarms, targets = counts
    scored = f"{notes.get('alarms_file') or title}, {alarms} alarms"
    rows = [
        ("vendor", _note(notes, "vendor")),
        ("scored", _with_digest(scored, notes.get("alarms_sha256"))),
        ("against", _with_digest(f"{targets} targets", truth_digest)),
        ("date of the score", _note(notes, "scored_on")),
        ("lane", lane),
        ("rules", rules),
    ]
    if "ranking" in notes:
        rows.append(("ranking", f"{notes['ranking']}; the page has one operating point"))
    return _block(rows, notes, notes.get("alarms_file", title), margin or lane, rules)


def comparison_block(
    names: Sequence[str],
    lanes: Mapping[str, Lane],
    rules: Mapping[str, Any],
    notes: Mapping[str, Mapping[str, Any]],
) -> TrialBlock:
    """Return the head of a comparison: a table of the lists, and what they have in common.

    Parameters
    ----------
    names : sequence of str
        Names of the lists.
    lanes : mapping of str to Lane
        The lanes by name; empty where they are sealed.
    rules : mapping
        Rules of the scores: ``halo_radius``, ``area_rule`` and ``level``.
    notes : mapping of str to mapping
        Provenance of every list, as for :func:`score_block`.

    Returns
    -------
    TrialBlock
        The head.
    """
    lists = []
    for name in names:
        of_list = notes.get(name, {})
        lists.append(
            [
                name,
                _note(of_list, "vendor"),
                _note(of_list, "alarms_file"),
                _note(of_list, "alarms_sha256"),
                "equal" if "ranking" in of_list else "by confidence",
            ]
        )
    first = notes.get(names[0], {})
    lane = lanes_in_words(lanes) if lanes else "sealed with the truth"
    stated_rules = (
        f"halo radius {rules['halo_radius']:g} m, area rule {rules['area_rule']}, "
        f"{100 * rules['level']:g} % intervals"
    )
    rows = [
        ("date of the score", _note(first, "scored_on")),
        ("lane", lane),
        ("rules", stated_rules),
    ]
    vendors = sorted({row[1] for row in lists} - {NOT_STATED})
    return replace(
        _block(rows, first, "", lane, stated_rules),
        head=["detector", "vendor", "file", "SHA-256", "ranking"],
        lists=lists,
        top_left=", ".join(vendors or names),
    )


def lanes_in_words(lanes: Mapping[str, Lane]) -> str:
    """Return the borders of lanes in words; of many, their number and area."""
    area = sum(lane.area for lane in lanes.values())
    if len(lanes) > _MOST_LANES:
        return f"{len(lanes)} lanes, {area:g} m² together"
    return f"{borders_in_words(lanes)} ({area:g} m²)"


def borders_in_words(lanes: Mapping[str, Lane]) -> str:
    """Return the borders of each lane, m."""
    texts = []
    for name, lane in lanes.items():
        borders = f"x {lane.x_min:g} to {lane.x_max:g} m, y {lane.y_min:g} to {lane.y_max:g} m"
        texts.append(f"{name}: {borders}" if name else borders)
    return "; ".join(texts)


def _block(
    rows: list[tuple[str, str]], notes: Mapping[str, Any], scored: str, lane: str, rules: str
) -> TrialBlock:
    """Return a head with the margins that follow from it."""
    vendor = _note(notes, "vendor")
    digest = str(notes.get("alarms_sha256", ""))[:_DIGEST]
    top_left = scored if vendor == NOT_STATED else f"{vendor}: {scored}"
    if digest:
        top_left += f" ({digest})"
    day = _note(notes, "scored_on")
    top_right = "" if day == NOT_STATED else f"scored on {day}"
    return TrialBlock(rows, top_left=top_left, top_right=top_right, bottom_left=f"{lane}; {rules}")


def _note(notes: Mapping[str, Any], name: str) -> str:
    """Return a note as text, or that it is not stated."""
    return str(notes.get(name) or NOT_STATED)


def _with_digest(text: str, digest: Any) -> str:
    """Return a text with a digest behind it, if there is one."""
    return f"{text}, SHA-256 {digest}" if digest else text
