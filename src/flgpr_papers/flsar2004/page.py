"""The page of the reproduction: findings, figures and tables of the paper beside ours."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from flgpr_papers.flsar2004.experiment import Results
from flgpr_papers.flsar2004.lanes import Settings
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
    notes = results.notes
    twins = list(_twins(results.findings, pictures))
    return study_html(
        "flsar2004.html",
        quick=quick,
        study_world=study_world,
        other=other,
        settings=settings,
        found=results.findings,
        chance=by_chance(results.findings),
        sizes=_sizes(settings, notes),
        areas=_areas(results),
        cases=list(notes["templates"]),
        templates=_variants(notes["templates"]),
        energy=notes["energy of the first component"],
        registration=_registration(notes["registration"]),
        twins=[one for one in twins if one.number],
        others=[one for one in twins if not one.number],
    )


def _twins(found: Sequence[Finding], pictures: Mapping[str, bytes]) -> Iterator[Twin]:
    """Put each figure beside what the paper says of it, in the order of the captions."""
    for name, one in _CAPTIONS.items():
        if name not in pictures:
            continue
        claims = tuple(one.get("claims", ()))
        numbers = [
            (each.claim, each.paper, each.ours) for each in found if each.claim.startswith(claims)
        ]
        stated = [
            (quantity, paper, "as in the paper") for quantity, paper in one.get("same", {}).items()
        ]
        yield Twin(
            one.get("number", ""), one["title"], pictures[name], one["caption"], [*stated, *numbers]
        )


def _sizes(settings: Settings, notes: Mapping[str, Any]) -> list[Row]:
    loo = notes["vectors, leave-one-out"]
    metal, plastic = (
        sum(getattr(mines, kind) for mines in settings.mines) for kind in ("metal", "plastic")
    )
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
    for site, counts in notes["examples"].items():
        told = ", ".join(f"{count} {kind}" for kind, count in counts.items())
        rows.append((f"examples without prescreener, both looks, {site}", "not given", told))
    for name, told in notes.items():
        if name.startswith(("prescreen", "fig5")):
            text = (
                ", ".join(f"{k}: {_short(v)}" for k, v in told.items())
                if isinstance(told, dict)
                else str(told)
            )
            rows.append((name, "", text))
    return rows


def _areas(results: Results) -> list[Row]:
    """Tell both areas of every curve; whole areas that were trained anew in every draw have no partial one."""
    rows = []
    for name, whole in results.areas.items():
        partial = results.partial.get(name)
        chance = results.chance.get(name)
        rows.append(
            (
                name,
                "" if partial is None else in_words(*partial),
                "" if chance is None else f"{chance:.2f}",
                in_words(*whole),
            )
        )
    return rows


def _short(value: Any) -> str:
    return f"{value:.2f}" if isinstance(value, float) else str(value)


def _variants(told: Mapping[str, Any]) -> list[Row]:
    """Tell for each kind of template the number of every case and by how much it lies above the main one's."""
    form = "{:.2f} ({:.2f} to {:.2f}); {:+.2f} ({:+.2f} to {:+.2f})".format
    return [
        (
            name,
            *(
                form(*case[name]["area"], *case[name]["less the main one"])
                for case in told.values()
            ),
        )
        for name in next(iter(told.values()))
    ]


def _registration(told: Mapping[str, Any]) -> list[Row]:
    rows = []
    for site, found in told.items():
        for name, one in found.items():
            across, along = (f"{100 * shift:+.1f}" for shift in one["shift"])
            rows.append(
                (
                    site,
                    name,
                    f"{across}, {along} cm",
                    f"{100 * one['residual']:.1f} cm",
                    one["fiducials"],
                )
            )
    return rows
