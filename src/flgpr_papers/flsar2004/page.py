"""The page of the reproduction: findings, figures and tables of the paper beside ours."""

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
    """Write the page, which needs nothing beside it."""
    details = results.details
    twins = list(_twins(results.findings, pictures))
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
        twins=[twin for twin in twins if twin.number],
        others=[twin for twin in twins if not twin.number],
    )


def _twins(found: Sequence[Finding], pictures: Mapping[str, bytes]) -> Iterator[Twin]:
    """Put each figure beside what the paper says of it, in the order of the captions."""
    for name, caption in _CAPTIONS.items():
        if name not in pictures:
            continue
        claims = tuple(caption.get("claims", ()))
        numbers = [
            (finding.claim, finding.paper, finding.ours)
            for finding in found
            if finding.claim.startswith(claims)
        ]
        stated = [
            (quantity, paper, "as in the paper")
            for quantity, paper in caption.get("same", {}).items()
        ]
        yield Twin(
            caption.get("number", ""),
            caption["title"],
            pictures[name],
            caption["caption"],
            [*stated, *numbers],
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
        counts_in_words = ", ".join(f"{count} {kind}" for kind, count in counts.items())
        rows.append(
            (f"examples without prescreener, both looks, {site}", "not given", counts_in_words)
        )
    for name, counts_in_words in details.items():
        if name.startswith(("prescreen", "fig5")):
            text = (
                ", ".join(f"{k}: {_short(v)}" for k, v in counts_in_words.items())
                if isinstance(counts_in_words, dict)
                else str(counts_in_words)
            )
            rows.append((name, "", text))
    return rows


def _areas(results: Results) -> list[Row]:
    """Return both areas of every curve.

    Whole areas that were trained anew in every draw have no partial one.
    """
    rows = []
    for name, area in results.areas.items():
        partial = results.partial.get(name)
        chance = results.chance.get(name)
        rows.append(
            (
                name,
                "" if partial is None else in_words(*partial),
                "" if chance is None else f"{chance:.2f}",
                in_words(*area),
            )
        )
    return rows


def _short(value: Any) -> str:
    """Return a value as text, a number with two decimals."""
    return f"{value:.2f}" if isinstance(value, float) else str(value)


def _variants(summary: Mapping[str, Any]) -> list[Row]:
    """Return for each kind of template the number of every case.

    Also by how much it lies above the main one's.
    """
    form = "{:.2f} ({:.2f} to {:.2f}); {:+.2f} ({:+.2f} to {:+.2f})".format
    first_case = next(iter(summary.values()))
    rows: list[Row] = []
    for name in first_case:
        cells = []
        for case in summary.values():
            cells.append(form(*case[name]["area"], *case[name]["less the main one"]))
        rows.append((name, *cells))
    return rows


def _registration(summary: Mapping[str, Any]) -> list[Row]:
    """Tabulate how well the fiducials register the images."""
    rows = []
    for site, by_pass in summary.items():
        for name, registered in by_pass.items():
            across, along = (f"{100 * shift:+.1f}" for shift in registered["shift"])
            rows.append(
                (
                    site,
                    name,
                    f"{across}, {along} cm",
                    f"{100 * registered['residual']:.1f} cm",
                    registered["fiducials"],
                )
            )
    return rows
