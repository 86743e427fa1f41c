"""The statements of Wang et al. 2007 in a world of one's choice, on small lanes."""

from __future__ import annotations

from pathlib import Path

from flgpr.chain.progress import silent
from flgpr.chain.recipe import parse_recipe
from flgpr_papers.kit.findings import Finding
from flgpr_papers.kit.settings import packaged_text
from flgpr_papers.kit.worlds import World
from flgpr_papers.wang2007.findings import all_findings
from flgpr_papers.wang2007.lanes import quick_scenes, sensor
from flgpr_papers.wang2007.study import lane_result


def findings_in(world: World, folder: Path) -> list[Finding]:
    """Judge the paper's statements on three calibration lanes and a blind one."""
    text, radar = packaged_text("wang2007"), sensor()
    calibration, blind = (
        [
            lane_result(folder, scene, seed + 1000 * (world.number + 1), radar, text, silent)
            for scene, seed in scenes.values()
        ]
        for scenes in quick_scenes(world.site(folder))
    )
    return all_findings(calibration, blind, parse_recipe(text), draws=100)[0]
