"""Reproduce flsar2004: prescreeners, template features, relevance and support vector machines.

The study in order: simulate the lane of each of two sites in both directions and image it, join the
drives and cut examples, run the parts of the experiment, write findings, figures and the page.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

import pandas as pd

import flgpr
from flgpr.progress import Track, silent
from flgpr.store import write_whole
from flgpr_papers.flsar2004 import figures
from flgpr_papers.flsar2004.examples import join
from flgpr_papers.flsar2004.experiment import PARTS
from flgpr_papers.flsar2004.lanes import drive, load_settings
from flgpr_papers.flsar2004.material import Material, Results, prepare
from flgpr_papers.flsar2004.page import page_html
from flgpr_papers.kit.cache import key_of, read_or_make
from flgpr_papers.kit.findings import finding_of, write_findings
from flgpr_papers.kit.page import draw
from flgpr_papers.kit.study_worlds import OWN, other_world, study_world
from flgpr_papers.kit.threads import one_blas_thread

PAGE = "flsar2004.html"


@one_blas_thread
def reproduce(
    output: str | Path, quick: bool = False, track: Track = silent, world: str = OWN
) -> Path:
    """Simulate the lanes, run the parts of the experiment, and write page, figures and findings.

    Lane images and the results of every part stay in ``output``, so that an interrupted run
    resumes.

    Parameters
    ----------
    output : str or Path
        Folder to work in.
    quick : bool
        Few mines, tones and draws, which only show that everything runs.
    track : Track
        Shows progress.
    world : str
        World of the lanes, see `flgpr_papers.kit.study_worlds`.

    Returns
    -------
    Path
        The page.
    """
    folder = Path(output)
    folder.mkdir(parents=True, exist_ok=True)
    settings = load_settings(quick, world)
    sites = []
    image_keys = []
    for site in settings.sites:
        passes = drive(settings, site, folder / "images", track)
        image_keys += [drive_pass.key for drive_pass in passes]
        sites.append(join(settings, passes))
    key = key_of(settings.model_dump(mode="json"), image_keys, flgpr.__version__)
    results = _parts(prepare(settings, sites), folder / "parts", key, track)
    write_findings(folder, results.findings, quick, world=world)
    summary = json.dumps(_as_json(results, curves=False), indent=1)
    write_whole(folder / "results.json", summary + "\n")
    pictures = {}
    drawn = figures.draw(settings, sites, results.curves, results.details)
    for name, figure in track(drawn, "drawing the page", 14):
        pictures[name] = draw(figure, quick)
    for name, picture in pictures.items():
        write_whole(folder / f"{name}.png", picture)
    html = page_html(
        settings,
        results,
        pictures,
        quick,
        study_world("flsar2004", world),
        other_world(folder, PAGE, world, quick),
    )
    write_whole(folder / PAGE, html)
    return folder / PAGE


def _parts(material: Material, folder: Path, key: str, track: Track) -> Results:
    """Run the parts that are not on disk, and read the others.

    A part on disk is of the same settings, images and version, which are in its key.
    """
    results = Results()
    for name, part in track(PARTS.items(), "experiments", len(PARTS)):
        path = folder / f"{name.replace(' ', '-')}-{key}.json"
        record = read_or_make(path, partial(_run_part, part, material))
        results.add(_from_json(record))
    return results


def _run_part(part: Callable[[Material], Results], material: Material) -> dict[str, Any]:
    """Run a part and return its results as JSON can hold them."""
    return _as_json(part(material))


def _as_json(results: Results, curves: bool = True) -> dict[str, Any]:
    """Return results as JSON can hold them."""
    record: dict[str, Any] = {
        "findings": [asdict(finding) for finding in results.findings],
        "areas": results.areas,
        "partial": results.partial,
        "chance": results.chance,
        "notes": results.details,
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
