"""Reproduce flsar2004.

Prescreeners, template features, relevance and support vector machines at two sites.
"""

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
from flgpr_papers.kit.cache import key_of, read_or_make
from flgpr_papers.kit.findings import Finding, finding_of, write_findings
from flgpr_papers.kit.page import draw
from flgpr_papers.kit.study_worlds import OWN, other_world, study_world
from flgpr_papers.kit.threads import one_blas_thread
from flgpr_papers.kit.worlds import World

PAGE = "flsar2004.html"


@one_blas_thread
def reproduce(
    output: str | Path, quick: bool = False, track: Track = silent, world: str = OWN
) -> Path:
    """Simulate the lanes, run the experiments, and write page, figures and findings.

    Lane images and every part's results are kept in ``output``, so that a run that was stopped goes
    on where it was.
    """
    folder = Path(output)
    folder.mkdir(parents=True, exist_ok=True)
    settings = load_settings(quick, world)
    drives = [drive(settings, site, folder / "images", track) for site in settings.sites]
    sites = [join(settings, passes) for passes in drives]
    key = key_of(
        settings.model_dump(mode="json"),
        [drive_pass.key for passes in drives for drive_pass in passes],
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
    """Run the parts that are not on disk, and read the others.

    Those on disk are of the same settings, images and version.
    """
    results = Results()
    for name, part in track(PARTS.items(), "experiments", len(PARTS)):
        path = folder / f"{name.replace(' ', '-')}-{key}.json"
        results.add(_from_json(read_or_make(path, lambda part=part: _as_json(part(material)))))  # type: ignore[misc]
    return results


def _as_json(results: Results, curves: bool = True) -> dict[str, Any]:
    """Return results as JSON can hold them."""
    record: dict[str, Any] = {
        "findings": [asdict(finding) for finding in results.findings],
        "areas": results.areas,
        "partial": results.partial,
        "chance": results.chance,
        "notes": results.notes,
    }
    if curves:
        record["curves"] = {}
        for name, figure in results.curves.items():
            columns = {label: curve.to_dict("list") for label, curve in figure.items()}
            record["curves"][name] = columns
    return record


def _from_json(record: dict[str, Any]) -> Results:
    """Return results from their JSON."""
    curves = {}
    for name, figure in record["curves"].items():
        curves[name] = {label: pd.DataFrame(curve) for label, curve in figure.items()}
    areas = {name: _interval(numbers) for name, numbers in record["areas"].items()}
    partial = {name: _interval(numbers) for name, numbers in record["partial"].items()}
    findings = [finding_of(row) for row in record["findings"]]
    return Results(curves, areas, partial, record["chance"], findings, record["notes"])


def _interval(numbers: list[float]) -> tuple[float, float, float]:
    """Return the value and the ends of an interval."""
    value, low, high = numbers
    return value, low, high


# The paper's two sites are the two losses of a world.
SITES = {"arid": "low", "temperate": "mironov"}


def findings_in(world: World, folder: Path) -> list[Finding]:
    """Judge the paper's statements at two sites of a world that differ in their loss."""
    settings = load_settings(quick=True)
    scenes = {name: replace(world, loss=loss).site(folder) for name, loss in SITES.items()}
    content = {
        "sites": tuple(SITES),
        "scenes": scenes,
        "seed": settings.seed + 100 * (world.number + 1),
    }
    settings = settings.model_copy(update=content)
    material = prepare(
        settings, [join(settings, drive(settings, site, folder)) for site in settings.sites]
    )
    findings: list[Finding] = []
    for part in JUDGED.values():
        try:
            findings += part(material).findings
        except (
            ValueError
        ):  # a fold of so few mines may hold none; the map tells how many worlds each statement has
            continue
    return findings
