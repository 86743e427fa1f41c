"""The studies of the papers in a world: the quick form of each, on lanes of that world."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from flgpr.progress import silent
from flgpr.recipe.schema import parse_recipe
from flgpr_papers.cosgrove2004.findings import findings, pd_table
from flgpr_papers.cosgrove2004.recipe import study_recipe
from flgpr_papers.cosgrove2004.study import run_seed
from flgpr_papers.flsar2004.examples import join
from flgpr_papers.flsar2004.experiment import JUDGED
from flgpr_papers.flsar2004.findings import prepare
from flgpr_papers.flsar2004.lanes import drive, load_settings
from flgpr_papers.fuse2018.findings import paper_findings
from flgpr_papers.fuse2018.lanes import fuse_recipe, simulate_lane
from flgpr_papers.fuse2018.process import (
    calibrate,
    process_lane,
    read_records,
    write_records,
)
from flgpr_papers.kit.findings import OPEN, Finding, measured
from flgpr_papers.kit.intervals import students
from flgpr_papers.kit.settings import packaged_text
from flgpr_papers.wang2007.findings import all_findings
from flgpr_papers.wang2007.lanes import quick_scenes, sensor
from flgpr_papers.wang2007.study import lane_result
from worlds.space import World

SITES = {"arid": "low", "temperate": "mironov"}
"""Loss of a world's soil at each of the two sites of flsar2004."""
# Seeds, and mines by depth (m), of a world: fewer than the study's, for there are many worlds.
_SEEDS = 2
_MINES = {"training": {"0.10": 4}, "test": {"0.01": 3, "0.05": 3, "0.15": 3}}


def cosgrove2004(world: World, folder: Path) -> list[Finding]:
    """Judge the paper's statements on one soil, and measure Pd, by which soils can be compared."""
    study = study_recipe()
    changes = {"title": "this soil", "scene": world.site(folder), **_MINES}
    site = study.sites["sand"].model_copy(update=changes)
    study = study.model_copy(update={"sites": {"sand": site}})
    first_seed = 1 + _SEEDS * (world.number + 100)
    cases = []
    for seed in range(first_seed, first_seed + _SEEDS):
        cases.append(run_seed(study, seed, 1.0)["roadside"]["sand"])
    table = pd_table(study, {"sand": cases})
    statements = []
    for finding in findings(study, {"sand": cases}):
        if finding.verdict != OPEN:
            statements.append(finding)
    pds = table.loc[table["detector"] == f"rank {study.detector.rank}", "pd"]
    pd_of_soil = measured(
        "Pd of the deflection detector",
        "not stated for such a soil",
        f"at {study.score.pfa:g} per m²",
        students(pds.to_numpy(), bounds=(0.0, 1.0)),
    )
    return [*statements, pd_of_soil]


def flsar2004(world: World, folder: Path) -> list[Finding]:
    """Judge the paper's statements at two sites of a world that differ in their loss."""
    settings = load_settings(quick=True)
    scenes = {}
    for site, loss in SITES.items():
        scenes[site] = replace(world, loss=loss).site(folder)
    seed = settings.seed + 100 * (world.number + 1)
    changes = {"sites": tuple(SITES), "scenes": scenes, "seed": seed}
    settings = settings.model_copy(update=changes)
    sites = [join(settings, drive(settings, site, folder)) for site in settings.sites]
    material = prepare(settings, sites)
    judged: list[Finding] = []
    for part in JUDGED.values():
        try:
            judged += part(material).findings
        except ValueError:
            # A fold of so few mines may hold none. The map tells how many worlds each statement
            # has.
            continue
    return judged


def fuse2018(world: World, folder: Path) -> list[Finding]:
    """Judge the paper's statements on lane A of a world, with that world's calibration lane."""
    recipe = fuse_recipe(quick=True)
    first_seed = 1000 * (world.number + 1)
    seeds = {"calibration": first_seed, "A": first_seed + 1}
    changes = {"site": world.site(folder), "seeds": seeds, **world.roadside_density}
    lanes = recipe.lanes.model_copy(update=changes)
    radar = recipe.radar.model_copy(update={"scatterers": 25.0})  # per m²
    recipe = recipe.model_copy(update={"lanes": lanes, "radar": radar})
    calibration_frames = simulate_lane(folder, recipe, "calibration", silent)
    calibration = calibrate(calibration_frames, recipe, silent)
    frames = simulate_lane(folder, recipe, "A", silent)
    records = process_lane(frames, calibration, recipe, silent, ("original", "iteration"))
    path = folder / "A.json"
    write_records(path, frames, records)
    return paper_findings([read_records(path, frames)], recipe)


def wang2007(world: World, folder: Path) -> list[Finding]:
    """Judge the paper's statements in a world, on three short calibration lanes and a blind one."""
    text = packaged_text("wang2007")
    radar = sensor()
    first_seed = 1000 * (world.number + 1)
    results = []
    for lanes in quick_scenes(world.site(folder)):
        of_kind = []
        for scene, seed in lanes.values():
            of_kind.append(lane_result(folder, scene, seed + first_seed, radar, text, silent))
        results.append(of_kind)
    judged, _ = all_findings(*results, parse_recipe(text), draws=100)
    return judged


FINDINGS_IN: dict[str, Callable[[World, Path], list[Finding]]] = {
    "cosgrove2004": cosgrove2004,
    "flsar2004": flsar2004,
    "fuse2018": fuse2018,
    "wang2007": wang2007,
}
"""What judges the statements of each paper in a world, working in a folder."""
