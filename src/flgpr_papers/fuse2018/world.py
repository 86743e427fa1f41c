"""The statements of Fuse et al. 2018 in a world of one's choice, on small lanes."""

from __future__ import annotations

from pathlib import Path

from flgpr.chain.progress import silent
from flgpr_papers.fuse2018.findings import paper_findings
from flgpr_papers.fuse2018.lanes import simulate_lane
from flgpr_papers.fuse2018.process import calibrate, process_lane
from flgpr_papers.fuse2018.recipe import fuse_recipe
from flgpr_papers.fuse2018.results import read_records, write_records
from flgpr_papers.kit.findings import Finding
from flgpr_papers.kit.worlds import World


def findings_in(world: World, folder: Path) -> list[Finding]:
    """Judge the paper's statements on lane A, by thresholds of the calibration lane of the same world."""
    recipe = fuse_recipe(quick=True)
    seeds = {name: 1000 * (world.number + 1) + k for k, name in enumerate(("calibration", "A"))}
    there = {"site": world.site(folder), "seeds": seeds, **world.roadside_density}
    recipe = recipe.model_copy(
        update={
            "lanes": recipe.lanes.model_copy(update=there),
            "radar": recipe.radar.model_copy(update={"scatterers": 25.0}),  # per m²
        }
    )
    calibration = calibrate(simulate_lane(folder, recipe, "calibration", silent), recipe, silent)
    frames, path = simulate_lane(folder, recipe, "A", silent), folder / "A.json"
    records = process_lane(frames, calibration, recipe, silent, ("original", "iteration"))
    write_records(path, frames, records)
    return paper_findings([read_records(path, frames)], recipe)
