"""The statements of Cosgrove et al. 2004 in a world of one's choice, on small lanes."""

from __future__ import annotations

from pathlib import Path

from flgpr_papers.cosgrove2004.findings import findings, interval, pd_table
from flgpr_papers.cosgrove2004.recipe import study_recipe
from flgpr_papers.cosgrove2004.study import run_seed
from flgpr_papers.kit.findings import OPEN, Finding, measured
from flgpr_papers.kit.worlds import World

_SEEDS = 2
_TRAINING, _TEST = {"0.10": 4}, {"0.01": 3, "0.05": 3, "0.15": 3}


def findings_in(world: World, folder: Path) -> list[Finding]:
    """Judge the paper's statements on one soil, and tell its Pd, by which soils can be compared."""
    study = study_recipe()
    site = study.sites["sand"].model_copy(
        update={"title": "this soil", "scene": world.site(folder), "training": _TRAINING, "test": _TEST}
    )
    study = study.model_copy(update={"sites": {"sand": site}})
    first = 1 + _SEEDS * (world.number + 100)
    cases = [run_seed(study, seed, 1.0)["roadside"]["sand"] for seed in range(first, first + _SEEDS)]
    table = pd_table(study, {"sand": cases})
    found = [one for one in findings(study, {"sand": cases}, table) if one.verdict != OPEN]
    pds = table.loc[table["detector"] == f"rank {study.detector.rank}", "pd"]
    return [
        *found,
        measured("Pd of the deflection detector", "", f"at {study.score.pfa:g} per m²", interval(pds.to_numpy())),
    ]
