"""Reproduce Cosgrove et al. 2004 on simulated lanes: trained detection by deflection.

The study in order, seed by seed: simulate the lanes of every soil and image their mines, train the
detectors on some of the mines, score them on the others; then judge the paper's statements by all
seeds, draw the figures and write the page.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from numpy.typing import NDArray

from flgpr.detect import ChipDetector
from flgpr.method.model import Model, save_model
from flgpr.progress import Track, silent
from flgpr.stages.forms import learnt_of
from flgpr.store import write_whole
from flgpr_papers.cosgrove2004 import figures
from flgpr_papers.cosgrove2004.detect import (
    Training,
    detectors,
    eigenvalue_ratios,
    eigenvectors,
    learn,
    score_looks,
    target_cut,
)
from flgpr_papers.cosgrove2004.findings import Case, findings, pd_table
from flgpr_papers.cosgrove2004.images import (
    SURROUNDINGS,
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
from flgpr_papers.kit.findings import write_findings
from flgpr_papers.kit.page import draw
from flgpr_papers.kit.study_worlds import OWN, other_world, study_world
from flgpr_papers.kit.threads import one_blas_thread

ComplexArray = NDArray[np.complex128]
PAGE = "index.html"
Cases = Mapping[str, Mapping[str, Sequence[Case]]]
"""Cases of every seed by surroundings and site."""


@one_blas_thread
def reproduce(
    output: str | Path,
    quick: bool = False,
    track: Track = silent,
    recipe: StudyRecipe | None = None,
    world: str = OWN,
) -> Path:
    """Run the study and write its page, figures, findings and trained detectors.

    The scores of every seed's lanes stay in ``output/lanes``, so that an interrupted run resumes
    seed by seed.

    Parameters
    ----------
    output : str or Path
        Folder to work in.
    quick : bool
        A small study that only shows that everything runs.
    track : Track
        Shows progress.
    recipe : StudyRecipe, optional
        Recipe in place of the packaged one.
    world : str
        World of the lanes, see `flgpr_papers.kit.study_worlds`.

    Returns
    -------
    Path
        The page.
    """
    study = recipe or study_recipe(quick, world)
    folder = Path(output)
    seeds = _seeds(study)
    cases = _run_cases(study, folder, seeds, track)
    tables = {}
    findings_by_surroundings = {}
    judged = []
    for surroundings in SURROUNDINGS:
        table = pd_table(study, cases[surroundings])
        tables[surroundings] = table
        found = []
        for finding in findings(study, cases[surroundings], table):
            found.append(replace(finding, group=surroundings))
        findings_by_surroundings[surroundings] = found
        judged += found
    responses = {
        "with the ramp": point_response(study, True),
        "without": point_response(study, False),
    }
    pictures = {}
    for name, figure in _figures(study, cases, responses, seeds[0]).items():
        pictures[name] = draw(figure, quick)
        write_whole(folder / f"{name}.png", pictures[name])
    pds = pd.concat(tables, names=["world"]).reset_index("world")
    write_whole(folder / "pd.csv", pds.to_csv(index=False))
    resolution = {name: response.resolution for name, response in responses.items()}
    write_findings(folder, judged, quick, world=world, seeds=len(seeds), resolution_m=resolution)
    html = page_html(
        study,
        cases,
        tables,
        findings_by_surroundings,
        responses,
        pictures,
        quick,
        study_world("cosgrove2004", world),
        other_world(folder, PAGE, world, quick),
    )
    write_whole(folder / PAGE, html)
    return folder / PAGE


def run_seed(
    recipe: StudyRecipe, seed: int, share: float, models: Path | None = None
) -> dict[str, dict[str, Case]]:
    """Simulate every lane of a seed, train on it, and score every detector.

    Parameters
    ----------
    recipe : StudyRecipe
        The study.
    seed : int
        Seed of the lanes.
    share : float
        Share of the mines that are laid.
    models : Path, optional
        Folder for the trained detectors, a bundle for each site and surroundings.

    Returns
    -------
    dict
        Case by surroundings and site, as JSON can hold it.
    """
    cases: dict[str, dict[str, Case]] = {surroundings: {} for surroundings in SURROUNDINGS}
    sand_cuts: dict[str, ComplexArray] = {}
    response = point_response(recipe, filtered=recipe.image.filter == "ramp")
    visible = visible_mines(recipe, wide_image(recipe, seed))
    # Dry sand comes first: its detector is tried at the other sites.
    for site in sorted(recipe.sites, key=_is_not_sand):
        bare_looks = signature_looks(recipe, site)
        signatures = np.concatenate([target_cut(recipe, look) for look in bare_looks])
        humps = signature_humps(recipe, bare_looks)
        for surroundings, looks in lane_looks(recipe, site, seed, share).items():
            training = learn(recipe, [look for look in looks if look.trains])
            chip_detectors = detectors(
                recipe,
                training,
                signatures.astype(np.complex128),
                sand_cuts.get(surroundings),
            )
            if site == "sand":
                sand_cuts[surroundings] = training.white
            if models is not None:
                detector = chip_detectors[f"rank {recipe.detector.rank}"]
                _save_detector(models / f"{site}-{surroundings}", detector, training)
            has_wide_image = (surroundings, site) == ("open", "sand")
            cases[surroundings][site] = {
                **_lane_case(recipe, looks, training, chip_detectors),
                "signature_humps": humps,
                "visible": visible if has_wide_image else [],
                "point_width": response.resolution[1],
                "site": site,
                "seed": seed,
            }
    return cases


def _is_not_sand(site: str) -> bool:
    """Return whether a site is another one than that of dry sand."""
    return site != "sand"


def _save_detector(path: Path, detector: ChipDetector, training: Training) -> None:
    """Save a trained detector as the model that the recipe cosgrove2004 takes."""
    learnt = learnt_of(detector.forms, training.clutter)
    save_model(Model(stages={"map.deflection": learnt}), path, detector.notes)


def _lane_case(
    recipe: StudyRecipe,
    looks: Sequence[Look],
    training: Training,
    chip_detectors: dict[str, ChipDetector],
) -> Case:
    """Return what was measured on a lane: premises, eigenvalues, cuts and peaks."""
    test = [look for look in looks if not look.trains]
    cuts = []
    for look in _one_per_depth(looks):
        magnitude = np.abs(target_cut(recipe, look)[0]).astype(float)
        cuts.append({"depth": look.depth, "magnitude": magnitude.tolist()})
    peaks = {}
    for name, peaks_of_detector in score_looks(recipe, test, chip_detectors).items():
        peaks[name] = asdict(peaks_of_detector)
    return {
        "premises": look_measures(recipe, test, training.whitener),
        "training_looks": len(looks) - len(test),
        "test_looks": len(test),
        "ratios": eigenvalue_ratios(recipe, training).tolist(),
        "eigenvectors": np.abs(eigenvectors(recipe, training)).tolist(),
        "cuts": cuts,
        "peaks": peaks,
    }


def _run_cases(
    recipe: StudyRecipe, folder: Path, seeds: range, track: Track
) -> dict[str, dict[str, list[Case]]]:
    """Return the cases of all seeds by surroundings and site; those on disk are read."""
    cases_by_seed = []
    for seed in track(seeds, "lanes, seed by seed", len(seeds)):
        cases_by_seed.append(_seed_cases(recipe, folder, seed))
    cases: dict[str, dict[str, list[Case]]] = {}
    for surroundings in SURROUNDINGS:
        cases[surroundings] = {}
        for site in recipe.sites:
            of_site = [of_seed[surroundings][site] for of_seed in cases_by_seed]
            cases[surroundings][site] = of_site
    return cases


def _seed_cases(recipe: StudyRecipe, folder: Path, seed: int) -> dict[str, dict[str, Case]]:
    """Return the cases of a seed by surroundings and site, or read them if they are on disk."""
    models = folder / "models" if seed == 1 else None
    key = key_of(recipe.model_dump(mode="json"))

    def make() -> dict[str, dict[str, Case]]:
        return run_seed(recipe, seed, recipe.study.share, models)

    cases: dict[str, dict[str, Case]] = read_or_make(
        folder / "lanes" / f"seed-{seed}-{key}.json", make
    )
    return cases


def parts(quick: bool) -> list[str]:
    """Return the names of the seeds, each of which can be run by itself."""
    return [str(seed) for seed in _seeds(study_recipe(quick))]


@one_blas_thread
def make_part(folder: Path, seed: str, quick: bool, world: str = OWN) -> None:
    """Run the lanes of a seed, unless they are on disk.

    Parameters
    ----------
    folder : Path
        Folder of the study.
    seed : str
        The seed, see :func:`parts`.
    quick, world
        As of :func:`reproduce`.
    """
    _seed_cases(study_recipe(quick, world), folder, int(seed))


def _seeds(recipe: StudyRecipe) -> range:
    """Return the seeds of the study."""
    return range(1, 1 + recipe.study.seeds)


def _one_per_depth(looks: Sequence[Look]) -> list[Look]:
    """Return the first look at each depth, of the three smallest depths at most."""
    first = {look.depth: look for look in reversed(looks)}
    return [first[depth] for depth in sorted(first)][:3]


def _figures(
    recipe: StudyRecipe, cases: Cases, responses: Mapping[str, PointResponse], seed: int
) -> dict[str, Figure]:
    """Draw the figures of the page by name, the paper's first, in its order."""
    image = wide_image(recipe, seed)
    drawn = {
        "figure-1": figures.geometry(recipe),
        "figure-2": figures.sample_image(image),
        "figure-3": figures.simulated_signature(*signature_cuts(recipe)),
        "figure-5": figures.feature_vector(recipe, image),
        "resolution": figures.point_figure(responses),
    }
    for surroundings in SURROUNDINGS:
        lanes = cases[surroundings]
        sand = lanes["sand"][0]
        drawn[f"figure-4-{surroundings}"] = figures.imaged_signatures(recipe, sand["cuts"])
        drawn[f"figure-6-{surroundings}"] = figures.eigenvector_figure(
            recipe, np.array(sand["eigenvectors"]), np.array(sand["ratios"])
        )
        drawn[f"figure-7-{surroundings}"] = figures.roc_figure(recipe, lanes)
        drawn[f"depth-{surroundings}"] = figures.depth_figure(recipe, lanes)
    papers_figures = sorted(name for name in drawn if name.startswith("figure-"))
    own_figures = sorted(name for name in drawn if not name.startswith("figure-"))
    return {name: drawn[name] for name in (*papers_figures, *own_figures)}
