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
from flgpr.types import Entries
from flgpr_papers.flsar2004 import figures
from flgpr_papers.flsar2004.examples import join
from flgpr_papers.flsar2004.experiment import PARTS
from flgpr_papers.flsar2004.findings import Material, Results, prepare
from flgpr_papers.flsar2004.lanes import Settings, drive, load_settings
from flgpr_papers.kit.cache import key_of, read_or_make
from flgpr_papers.kit.findings import in_words
from flgpr_papers.kit.study import Outcome, Study


def page_tables(settings: Settings, results: Results) -> Entries:
    """Return what the template of the page takes."""
    notes = results.notes
    areas = []
    for name, area in results.areas.items():
        # Whole areas that were trained anew in every draw have no partial one.
        partial = ("", "")
        if name in results.partial:
            partial = (in_words(*results.partial[name]), f"{results.chance[name]:.2f}")
        areas.append((name, *partial, in_words(*area)))
    screened = {
        name: _note_text(value)
        for name, value in notes.items()
        if name.startswith(("prescreen", "fig5"))
    }
    return {"settings": settings, "areas": areas, "notes": notes, "screened": screened}


def _note_text(value: Any) -> str:
    """Format a note of the results: a text, or several named numbers."""
    if isinstance(value, dict):
        return ", ".join(f"{name}: {_note_text(number)}" for name, number in value.items())
    return f"{value:.2f}" if isinstance(value, float) else str(value)


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
        measured=figures.Measured(settings, sites, results),
        facts={},
        tables=page_tables(settings, results),
        files={"results.json": json.dumps(summary, indent=1) + "\n"},
    )


def _record(part: Callable[[Material], Results], material: Material) -> Entries:
    """Run a part and return its results as JSON can hold them."""
    return asdict(part(material))


STUDY = Study("flsar2004", "flsar2004.html", figures, run, style=_STYLE)
