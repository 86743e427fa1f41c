"""Reproduce flsar2004: prescreeners, template features, relevance and support vector machines at two sites."""

from __future__ import annotations

import json
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import pandas as pd

import flgpr
from flgpr.chain.progress import Track, silent
from flgpr.store import write_whole
from flgpr_papers.flsar2004 import figures
from flgpr_papers.flsar2004.examples import join
from flgpr_papers.flsar2004.experiment import JUDGED, PARTS, Material, Results, prepare
from flgpr_papers.flsar2004.lanes import drive, load_settings
from flgpr_papers.flsar2004.page import page_html
from flgpr_papers.kit.cache import kept, key_of
from flgpr_papers.kit.findings import Finding, finding_of, write_findings
from flgpr_papers.kit.page import draw
from flgpr_papers.kit.study_worlds import OWN, other_world, study_world
from flgpr_papers.kit.worlds import World

PAGE = "flsar2004.html"


def reproduce(
    output: str | Path, quick: bool = False, track: Track = silent, world: str = OWN
) -> Path:
    """Simulate the lanes, run the experiments on them, and write the page, the figures and the findings.

    Lane images and every part's results are kept in ``output``, so that a run that was stopped goes on where it was.
    """
    folder = Path(output)
    folder.mkdir(parents=True, exist_ok=True)
    settings = load_settings(quick, world)
    drives = [drive(settings, site, folder / "images", track) for site in settings.sites]
    sites = [join(settings, passes) for passes in drives]
    key = key_of(
        settings.model_dump(mode="json"),
        [one.key for passes in drives for one in passes],
        flgpr.__version__,
    )
    results = _parts(prepare(settings, sites), folder / "parts", key, track)
    write_findings(folder, results.findings, quick, world=world)
    write_whole(
        folder / "results.json", json.dumps(_as_json(results, curves=False), indent=1) + "\n"
    )
    drawn = figures.draw(settings, sites, results.curves, results.notes)
    pictures = {name: draw(figure, quick) for name, figure in track(drawn, "drawing the page", 14)}
    for name, picture in pictures.items():
        write_whole(folder / f"{name}.png", picture)
    page = folder / PAGE
    worlds = study_world("flsar2004", world), other_world(folder, PAGE, world, quick)
    write_whole(page, page_html(settings, results, pictures, quick, *worlds))
    return page


def _parts(material: Material, folder: Path, key: str, track: Track) -> Results:
    """Run the parts that are not on disk for the same settings, images and version, and read the others."""
    results = Results()
    for name, part in track(PARTS.items(), "experiments", len(PARTS)):
        path = folder / f"{name.replace(' ', '-')}-{key}.json"
        results.add(_from_json(kept(path, lambda part=part: _as_json(part(material)))))  # type: ignore[misc]
    return results


def _as_json(results: Results, curves: bool = True) -> dict[str, Any]:
    record = {
        "findings": [asdict(one) for one in results.findings],
        "areas": results.areas,
        "partial": results.partial,
        "chance": results.chance,
        "notes": results.notes,
    }
    if curves:
        record["curves"] = {
            name: {label: curve.to_dict("list") for label, curve in figure.items()}
            for name, figure in results.curves.items()
        }
    return record


def _from_json(record: dict[str, Any]) -> Results:
    curves = {
        name: {label: pd.DataFrame(curve) for label, curve in figure.items()}
        for name, figure in record["curves"].items()
    }
    areas, partial = (
        {name: (one[0], one[1], one[2]) for name, one in record[key].items()}
        for key in ("areas", "partial")
    )
    findings = [finding_of(one) for one in record["findings"]]
    return Results(curves, areas, partial, record["chance"], findings, record["notes"])


SITES = {
    "arid": "low",
    "temperate": "mironov",
}  # the paper's two sites are the two losses of a world


def findings_in(world: World, folder: Path) -> list[Finding]:
    """Judge the paper's statements at two sites of a world that differ in their loss."""
    settings = load_settings(quick=True)
    scenes = {name: replace(world, loss=loss).site(folder) for name, loss in SITES.items()}
    own = {
        "sites": tuple(SITES),
        "scenes": scenes,
        "seed": settings.seed + 100 * (world.number + 1),
    }
    settings = settings.model_copy(update=own)
    material = prepare(
        settings, [join(settings, drive(settings, site, folder)) for site in settings.sites]
    )
    found: list[Finding] = []
    for part in JUDGED.values():
        try:
            found += part(material).findings
        except (
            ValueError
        ):  # a fold of so few mines may hold none; the map tells how many worlds each statement has
            continue
    return found
