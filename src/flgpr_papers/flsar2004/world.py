"""The statements of flsar2004 in a world of one's choice, on small lanes."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from flgpr_papers.flsar2004.examples import join
from flgpr_papers.flsar2004.experiment import JUDGED, prepare
from flgpr_papers.flsar2004.lanes import drive, load_settings
from flgpr_papers.kit.findings import Finding
from flgpr_papers.kit.worlds import World

SITES = {"arid": "low", "temperate": "mironov"}  # the paper's two sites are the two losses of a world


def findings_in(world: World, folder: Path) -> list[Finding]:
    """Judge the paper's statements at two sites of a world that differ in their loss."""
    settings = load_settings(quick=True)
    scenes = {name: replace(world, loss=loss).site(folder) for name, loss in SITES.items()}
    own = {"sites": tuple(SITES), "scenes": scenes, "seed": settings.seed + 100 * (world.number + 1)}
    settings = settings.model_copy(update=own)
    material = prepare(settings, [join(settings, drive(settings, site, folder)) for site in settings.sites])
    found: list[Finding] = []
    for part in JUDGED.values():
        try:
            found += part(material).findings
        except ValueError:  # a fold of so few mines may hold none; the map tells how many worlds each statement has
            continue
    return found
