"""The page of the reproduction: findings, figures and tables of the paper, and ours."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from flgpr_papers.flsar2004.lanes import Settings
from flgpr_papers.flsar2004.material import Results
from flgpr_papers.kit.findings import Finding, by_chance, in_words
from flgpr_papers.kit.page import Twin, study_html
from flgpr_papers.kit.settings import packaged_text
from flgpr_papers.kit.study_worlds import OtherWorld, StudyWorld

Row = tuple[Any, ...]
_CAPTIONS: dict[str, dict[str, Any]] = tomllib.loads(packaged_text("flsar2004", "captions"))


def page_html(
    settings: Settings,
    results: Results,
    pictures: Mapping[str, bytes],
    quick: bool,
    study_world: StudyWorld,
    other: OtherWorld,
) -> str:
    """Return the page, which needs no other file.

    Parameters
    ----------
    settings : Settings
        The study.
    results : Results
        Results of all parts.
    pictures : mapping of str to bytes
        Figures by name, PNG.
    quick : bool
        Whether the study is a quick run.
    study_world : StudyWorld
        World of the lanes.
    other : OtherWorld
        Findings of the same study on roads as found.
    """
    details = results.details
    papers_twins = []
    own_twins = []
    for twin in _twins(results.findings, pictures):
        if twin.number:
            papers_twins.append(twin)
        else:
            own_twins.append(twin)
    return study_html(
        "flsar2004.html",
        quick=quick,
        study_world=study_world,
        other=other,
        settings=settings,
        found=results.findings,
        chance=by_chance(results.findings),
        sizes=_sizes(settings, details),
        areas=_areas(results),
        cases=list(details["templates"]),
        templates=_variants(details["templates"]),
        energy=details["energy of the first component"],
        registration=_registration(details["registration"]),
        twins=papers_twins,
        others=own_twins,
    )


def _twins(findings: Sequence[Finding], pictures: Mapping[str, bytes]) -> Iterator[Twin]:
    """Yield each figure with what the paper says of it, in the order of the captions."""
    for name, caption in _CAPTIONS.items():
        if name not in pictures:
            continue
        numbers = []
        for quantity, paper in caption.get("same", {}).items():
            numbers.append((quantity, paper, "as in the paper"))
        claims = tuple(caption.get("claims", ()))
        for finding in findings:
            if finding.claim.startswith(claims):
                numbers.append((finding.claim, finding.paper, finding.ours))
        yield Twin(
            caption.get("number", ""),
            caption["title"],
            pictures[name],
            caption["caption"],
            numbers,
        )


def _sizes(settings: Settings, details: Mapping[str, Any]) -> list[Row]:
    """Tabulate numbers of mines and examples in the paper and here."""
    loo = details["vectors, leave-one-out"]
    metal = sum(mines.metal for mines in settings.mines)
    plastic = sum(mines.plastic for mines in settings.mines)
    rows: list[Row] = [
        ("mines per site, metal and plastic", "60 and 30", f"{metal} and {plastic}"),
        (
            "examples of the leave-one-out (par. 57)",
            "153, of them 27 mines",
            f"{loo['examples']}, {loo['mines']} mines",
        ),
        (
            "support vectors",
            "34 % (par. 48), typically 30 % (par. 57)",
            f"{100 * loo['SVM']:.1f} %",
        ),
        (
            "relevance vectors",
            "14 % (par. 48), typically 15 % (par. 57)",
            f"{100 * loo['RVM']:.1f} %",
        ),
        (
            "the same, prior by the evidence",
            "not said",
            f"{100 * loo['RVM, prior by the evidence']:.1f} %",
        ),
        (
            "the same, ARD and width by evidence",
            "not tried",
            f"{100 * loo['RVM, ARD, width by evidence']:.1f} %",
        ),
    ]
    for site, counts in details["examples"].items():
        text = ", ".join(f"{count} {kind}" for kind, count in counts.items())
        rows.append((f"examples without prescreener, both looks, {site}", "not given", text))
    for name, value in details.items():
        if name.startswith(("prescreen", "fig5")):
            rows.append((name, "", _detail_text(value)))
    return rows


def _detail_text(value: Any) -> str:
    """Format a detail of the results: a text, or several named numbers."""
    if not isinstance(value, dict):
        return str(value)
    return ", ".join(f"{name}: {_short(number)}" for name, number in value.items())


def _areas(results: Results) -> list[Row]:
    """Tabulate both areas of every curve.

    Whole areas that were trained anew in every draw have no partial one.
    """
    rows: list[Row] = []
    for name, area in results.areas.items():
        partial = ""
        chance = ""
        if name in results.partial:
            partial = in_words(*results.partial[name])
            chance = f"{results.chance[name]:.2f}"
        rows.append((name, partial, chance, in_words(*area)))
    return rows


def _short(value: Any) -> str:
    """Return a value as text, a number with two decimals."""
    return f"{value:.2f}" if isinstance(value, float) else str(value)


def _variants(summary: Mapping[str, Any]) -> list[Row]:
    """Tabulate the number of every kind of template in every case, and that less the main one's."""
    first_case = next(iter(summary.values()))
    rows: list[Row] = []
    for name in first_case:
        cells = []
        for case in summary.values():
            area, low, high = case[name]["area"]
            gap, gap_low, gap_high = case[name]["less the main one"]
            cells.append(
                f"{area:.2f} ({low:.2f} to {high:.2f}); "
                f"{gap:+.2f} ({gap_low:+.2f} to {gap_high:+.2f})"
            )
        rows.append((name, *cells))
    return rows


def _registration(summary: Mapping[str, Any]) -> list[Row]:
    """Tabulate how well the fiducials register the images."""
    rows: list[Row] = []
    for site, by_pass in summary.items():
        for name, registered in by_pass.items():
            across, along = registered["shift"]
            shift = f"{100 * across:+.1f}, {100 * along:+.1f} cm"
            residual = f"{100 * registered['residual']:.1f} cm"
            rows.append((site, name, shift, residual, registered["fiducials"]))
    return rows
