"""The study of Cosgrove et al. 2004 on simulated lanes.

Sites, training, detectors, figures, findings.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from numpy.typing import NDArray

from flgpr.chain.model import Model, save_model
from flgpr.chain.progress import Track, silent
from flgpr.chain.stages.forms import learnt_of
from flgpr.store import write_whole
from flgpr_papers.cosgrove2004 import figures
from flgpr_papers.cosgrove2004.detect import (
    detectors,
    eigenvalue_ratios,
    eigenvectors,
    learn,
    score_looks,
    target_cut,
)
from flgpr_papers.cosgrove2004.findings import Case, findings, interval, pd_table
from flgpr_papers.cosgrove2004.images import (
    WORLDS,
    Look,
    PointResponse,
    lane_looks,
    point_response,
    signature_cuts,
    signature_looks,
    wide_image,
)
from flgpr_papers.cosgrove2004.page import page_html
from flgpr_papers.cosgrove2004.recipe import StudyRecipe, study_recipe
from flgpr_papers.cosgrove2004.signature import look_measures, signature_humps, visible_mines
from flgpr_papers.kit.cache import key_of, read_or_make
from flgpr_papers.kit.findings import OPEN, Finding, measured, write_findings
from flgpr_papers.kit.page import draw
from flgpr_papers.kit.study_worlds import OWN, other_world, study_world
from flgpr_papers.kit.threads import one_blas_thread
from flgpr_papers.kit.worlds import World

ComplexArray = NDArray[np.complex128]
PAGE = "index.html"
Cases = Mapping[str, Mapping[str, Sequence[Case]]]


@one_blas_thread
def reproduce(
    output: str | Path,
    quick: bool = False,
    track: Track = silent,
    recipe: StudyRecipe | None = None,
    world: str = OWN,
) -> Path:
    """Run the study and write its page, figures, findings and trained detectors.

    ``recipe`` stands in for the packaged. Every lane's scores are kept in ``output/lanes``, so that
    a broken run goes on where it stopped.
    """
    study = recipe or study_recipe(quick, world)
    folder = Path(output)
    seeds = _seeds(study)
    cases = _run_cases(study, folder, seeds, track)
    tables = {world: pd_table(study, cases[world]) for world in WORLDS}
    findings_of_world = {world: findings(study, cases[world], tables[world]) for world in WORLDS}
    responses = {
        "with the ramp": point_response(study, True),
        "without": point_response(study, False),
    }
    drawn = _figures(study, cases, responses, seeds[0])
    pictures = {name: draw(figure, quick) for name, figure in drawn.items()}
    for name, picture in pictures.items():
        write_whole(folder / f"{name}.png", picture)
    rows = pd.concat(tables, names=["world"]).reset_index("world")
    write_whole(folder / "pd.csv", rows.to_csv(index=False))
    resolution = {name: response.resolution for name, response in responses.items()}
    judged = [
        replace(finding, group=world) for world in WORLDS for finding in findings_of_world[world]
    ]
    write_findings(folder, judged, quick, world=world, seeds=len(seeds), resolution_m=resolution)
    page = folder / PAGE
    grouped: dict[str, list[Finding]] = {name: [] for name in WORLDS}
    for finding in judged:
        grouped[finding.group].append(finding)
    worlds = study_world("cosgrove2004", world), other_world(folder, PAGE, world, quick)
    write_whole(page, page_html(study, cases, tables, grouped, responses, pictures, quick, *worlds))
    return page


def run_seed(
    recipe: StudyRecipe, seed: int, share: float, models: Path | None = None
) -> dict[str, dict[str, Case]]:
    """Simulate every lane of a seed, train on it and score every detector."""
    cases: dict[str, dict[str, Case]] = {world: {} for world in WORLDS}
    taught: dict[str, ComplexArray] = {}
    point_width = point_response(recipe, filtered=recipe.image.filter == "ramp").resolution[1]
    visible = visible_mines(recipe, wide_image(recipe, seed))
    for site in sorted(
        recipe.sites, key=lambda name: name != "sand"
    ):  # dry sand first: its detector is tried elsewhere
        bare_looks = signature_looks(recipe, site)
        signatures = np.concatenate([target_cut(recipe, look) for look in bare_looks])
        humps = signature_humps(recipe, bare_looks)
        for world, looks in lane_looks(recipe, site, seed, share).items():
            trains = [look for look in looks if look.trains]
            test = [look for look in looks if not look.trains]
            training = learn(recipe, trains)
            chip_detectors = detectors(
                recipe, training, signatures.astype(np.complex128), taught.get(world)
            )
            if site == "sand":
                taught[world] = training.white
            if models is not None:
                detector = chip_detectors[f"rank {recipe.detector.rank}"]
                learnt = learnt_of(detector.forms, training.clutter)
                save_model(
                    Model(stages={"map.deflection": learnt}),
                    models / f"{site}-{world}",
                    detector.notes,
                )
            cases[world][site] = {
                "premises": look_measures(recipe, test, training.whitener),
                "signature_humps": humps,
                "visible": visible if (world, site) == ("open", "sand") else [],
                "point_width": point_width,
                "site": site,
                "seed": seed,
                "training_looks": len(trains),
                "test_looks": len(test),
                "ratios": eigenvalue_ratios(recipe, training).tolist(),
                "eigenvectors": np.abs(eigenvectors(recipe, training)).tolist(),
                "cuts": [
                    {
                        "depth": look.depth,
                        "magnitude": np.abs(target_cut(recipe, look)[0]).astype(float).tolist(),
                    }
                    for look in _one_per_depth(looks)
                ],
                "peaks": {
                    name: asdict(peaks)
                    for name, peaks in score_looks(recipe, test, chip_detectors).items()
                },
            }
    return cases


def _run_cases(
    recipe: StudyRecipe, folder: Path, seeds: range, track: Track
) -> dict[str, dict[str, list[Case]]]:
    """Run the seeds that are not yet on disk, read the others; returns world, site, cases."""
    read = [
        _seed_cases(recipe, folder, seed)
        for seed in track(seeds, "lanes, seed by seed", len(seeds))
    ]
    cases: dict[str, dict[str, list[Case]]] = {}
    for world in WORLDS:
        cases[world] = {}
        for site in recipe.sites:
            cases[world][site] = [record[world][site] for record in read]
    return cases


def _seed_cases(recipe: StudyRecipe, folder: Path, seed: int) -> dict[str, dict[str, Case]]:
    """Return the cases of a seed, or read them if they are on disk."""
    share = recipe.study.share
    models = folder / "models" if seed == 1 else None
    path = folder / "lanes" / f"seed-{seed}-{key_of(recipe.model_dump(mode='json'))}.json"
    cases: dict[str, dict[str, Case]] = read_or_make(
        path, lambda: run_seed(recipe, seed, share, models)
    )
    return cases


def parts(quick: bool) -> list[str]:
    """List the seeds, each of which can be worked on by itself."""
    return [str(seed) for seed in _seeds(study_recipe(quick))]


@one_blas_thread
def make_part(folder: Path, seed: str, quick: bool, world: str = OWN) -> None:
    """Work on a seed."""
    _seed_cases(study_recipe(quick, world), folder, int(seed))


def _seeds(recipe: StudyRecipe) -> range:
    """Return the seeds of the study."""
    return range(1, 1 + recipe.study.seeds)


def _one_per_depth(looks: Sequence[Look]) -> list[Look]:
    """Return the first look at each depth, of three depths at most."""
    first = {look.depth: look for look in reversed(looks)}
    return [first[depth] for depth in sorted(first)][:3]


def _figures(
    recipe: StudyRecipe, cases: Cases, responses: Mapping[str, PointResponse], seed: int
) -> dict[str, Figure]:
    """Draw the figures of the page by name."""
    image = wide_image(recipe, seed)
    drawn = {
        "figure-1": figures.geometry(recipe),
        "figure-2": figures.sample_image(image),
        "figure-3": figures.simulated_signature(*signature_cuts(recipe)),
        "figure-5": figures.feature_vector(recipe, image),
        "resolution": figures.point_figure(responses),
    }
    for world in WORLDS:
        sand = cases[world]["sand"][0]
        drawn[f"figure-4-{world}"] = figures.imaged_signatures(recipe, sand["cuts"])
        drawn[f"figure-6-{world}"] = figures.eigenvector_figure(
            recipe, np.array(sand["eigenvectors"]), np.array(sand["ratios"])
        )
        drawn[f"figure-7-{world}"] = figures.roc_figure(recipe, cases[world])
        drawn[f"depth-{world}"] = figures.depth_figure(recipe, cases[world])
    # The paper's figures come first, in its order.
    return dict(
        sorted(drawn.items(), key=lambda item: (not item[0].startswith("figure-"), item[0]))
    )


_SEEDS = 2
_TRAINING = {"0.10": 4}
_TEST = {"0.01": 3, "0.05": 3, "0.15": 3}


def findings_in(world: World, folder: Path) -> list[Finding]:
    """Judge the paper's statements on one soil, and tell its Pd, by which soils can be compared."""
    study = study_recipe()
    site = study.sites["sand"].model_copy(
        update={
            "title": "this soil",
            "scene": world.site(folder),
            "training": _TRAINING,
            "test": _TEST,
        }
    )
    study = study.model_copy(update={"sites": {"sand": site}})
    first = 1 + _SEEDS * (world.number + 100)
    cases = [
        run_seed(study, seed, 1.0)["roadside"]["sand"] for seed in range(first, first + _SEEDS)
    ]
    table = pd_table(study, {"sand": cases})
    judged = [
        finding for finding in findings(study, {"sand": cases}, table) if finding.verdict != OPEN
    ]
    pds = table.loc[table["detector"] == f"rank {study.detector.rank}", "pd"]
    return [
        *judged,
        measured(
            "Pd of the deflection detector",
            "not stated for such a soil",
            f"at {study.score.pfa:g} per m²",
            interval(pds.to_numpy(), bounds=(0.0, 1.0)),
        ),
    ]
