"""Reproduce flsar2004: prescreeners, template features, relevance and support vector machines.

The study in order: simulate the lane of each of two sites in both directions and image it, join the
drives and cut examples, run the parts of the experiment.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

import flgpr
from flgpr.progress import Track
from flgpr_papers.flsar2004 import figures
from flgpr_papers.flsar2004.examples import join
from flgpr_papers.flsar2004.experiment import PARTS
from flgpr_papers.flsar2004.lanes import drive, load_settings
from flgpr_papers.flsar2004.material import Material, Results, prepare
from flgpr_papers.flsar2004.page import page_tables
from flgpr_papers.kit.cache import key_of, read_or_make
from flgpr_papers.kit.study import Outcome, Study

_STYLE = {"font.size": 9, "axes.grid": True, "grid.alpha": 0.3}


def run(folder: Path, quick: bool, track: Track, world: str) -> Outcome:
    """Image the lanes and run the parts of the experiment; both stay in the folder."""
    settings = load_settings(quick, world)
    sites = []
    image_keys = []
    for site in settings.sites:
        passes = drive(settings, site, folder / "images", track)
        image_keys += [drive_pass.key for drive_pass in passes]
        sites.append(join(settings, passes))
    key = key_of(settings.model_dump(mode="json"), image_keys, flgpr.__version__)
    material = prepare(settings, sites)
    results = Results()
    for name, part in track(PARTS.items(), "experiments", len(PARTS)):
        path = folder / "parts" / f"{name.replace(' ', '-')}-{key}.json"
        results.add(read_or_make(path, partial(_record, part, material)))
    summary = asdict(results)
    del summary["curves"]
    return Outcome(
        findings=results.findings,
        figures=figures.drawings(settings, sites, results.curves, results.notes),
        facts={},
        tables=page_tables(settings, results),
        files={"results.json": json.dumps(summary, indent=1) + "\n"},
    )


def _record(part: Callable[[Material], Results], material: Material) -> dict[str, Any]:
    """Run a part and return its results as JSON can hold them."""
    return asdict(part(material))


STUDY = Study("flsar2004", "flsar2004.html", run, style=_STYLE)
