"""Reproduce Cosgrove et al. 2004 on simulated lanes: trained detection by deflection.

The study in order, seed by seed: simulate the lanes of every soil and image their mines, train the
detectors on some of the mines, score them on the others; then judge the paper's statements by all
seeds.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from flgpr.method.model import Model, save_model
from flgpr.progress import Track
from flgpr.stages.forms import learnt_of
from flgpr.types import Complex128Array, Entries, floats
from flgpr_papers.cosgrove2004 import figures
from flgpr_papers.cosgrove2004.detect import (
    Training,
    detectors,
    eigenvalue_ratios,
    eigenvectors,
    example_detectors,
    example_looks,
    learn,
    one_polarization,
    other_bands,
    score_looks,
    target_cut,
)
from flgpr_papers.cosgrove2004.findings import (
    Case,
    contrast_table,
    eigenvalue_ratios_of,
    findings,
    found_looks,
    pd_table,
)
from flgpr_papers.cosgrove2004.images import (
    SURROUNDINGS,
    Look,
    PointResponse,
    lane_looks,
    point_response,
    signature_looks,
    study_sensor,
    wide_image,
)
from flgpr_papers.cosgrove2004.recipe import SOILS, StudyRecipe, study_recipe
from flgpr_papers.cosgrove2004.signature import look_measures, signature_humps, visible_mines
from flgpr_papers.kit.cache import key_of, read_or_make
from flgpr_papers.kit.findings import Finding, by_chance, in_words
from flgpr_papers.kit.intervals import SHARE, share_of_looks, students
from flgpr_papers.kit.study import Outcome, Study

Cases = Mapping[str, Mapping[str, Sequence[Case]]]
"""Cases of every seed by surroundings and site."""
BESIDE = {"open": "open lanes", "roadside": "beside bushes and posts"}
"""What stands beside a lane, in words."""
_ALONE = "in all seeds"  # what a number has in place of an interval where no seed differs


def page_facts(
    recipe: StudyRecipe,
    cases: Cases,
    tables: Mapping[str, pd.DataFrame],
    responses: Mapping[str, PointResponse],
) -> Entries:
    """Return what the captions and their numbers take.

    The parameters are those of :func:`page_tables`, and the image of a point with and without the
    ramp filter.
    """
    sensor = study_sensor(recipe)
    tx, _ = sensor.pairs()
    tones = sensor.tones.axis()
    length = recipe.cut.length
    polarizations = recipe.cut.polarizations
    return {
        "recipe": recipe,
        "sensor": sensor,
        "antennas": len(tx),
        "across": np.ptp(tx[:, 0]),
        "tones": (tones[0] / 1e9, tones[-1] / 1e9),
        "samples": ", then ".join(f"{length} of {name}" for name in polarizations),
        "features": length * len(polarizations),
        "ratios": {name: _ratio_texts(lanes["sand"]) for name, lanes in cases.items()},
        "pds": {name: _pd_texts(recipe, table) for name, table in tables.items()},
        "resolution": {
            name: [100 * width for width in response.resolution]
            for name, response in responses.items()
        },
    }


def page_tables(
    recipe: StudyRecipe,
    cases: Cases,
    tables: Mapping[str, pd.DataFrame],
    found: Sequence[Finding],
) -> Entries:
    """Return what the template of the page takes.

    Parameters
    ----------
    recipe : StudyRecipe
        The study.
    cases : mapping
        Cases of every seed by surroundings and site.
    tables : mapping of str to DataFrame
        Pd of every detector by surroundings.
    found : sequence of Finding
        The findings, with the surroundings for a group.
    """
    return {
        "recipe": recipe,
        "by_chance": {name: by_chance([f for f in found if f.group == name]) for name in BESIDE},
        "sizes": next(iter(cases.values())),
        "detectors": {
            name: _detector_table(recipe, cases[name], table) for name, table in tables.items()
        },
        "contrast": {name: contrast_table(lanes) for name, lanes in cases.items()},
        "beside": BESIDE,
    }


def _detector_table(
    recipe: StudyRecipe, cases: Mapping[str, Sequence[Case]], table: pd.DataFrame
) -> dict[str, dict[str, list[str]]]:
    """Return the detectors' Pd by site and detector, in words and in the order of the columns.

    Shares of looks have the intervals of the statements, the other two those over seeds.
    """
    # Those of the sweeps over examples stand in their figure.
    shown = table[~table["detector"].str.endswith("examples")]
    detectors: dict[str, dict[str, list[str]]] = {}
    for names, chosen in shown.groupby(["site", "detector"], sort=False):
        site, name = map(str, names)
        of_looks = [
            share_of_looks(found_looks(recipe, cases[site], name, quantile))
            for quantile in (False, True)
        ]
        columns = chosen[["pd_rockless", "pd_mean"]].to_numpy().T
        intervals = [*of_looks, *(students(column, bounds=SHARE) for column in columns)]
        words = [in_words(*interval, alone=_ALONE) for interval in intervals]
        detectors.setdefault(site, {})[name] = words
    return detectors


def _ratio_texts(lanes: Sequence[Case]) -> dict[int, str]:
    """Return the ratios of eigenvalues to the first, mean over the seeds with the interval."""
    return {
        number: "no example reaches it"
        if np.isnan(ratio)
        else in_words(ratio, low, high, alone=_ALONE)
        for number, _, (ratio, low, high) in eigenvalue_ratios_of(lanes)
    }


def _pd_texts(recipe: StudyRecipe, table: pd.DataFrame) -> dict[str, str]:
    """Return Pd at the study's P_FA, mean over the seeds, by soil."""
    names = {"deflection": recipe.main, "PWF": "PWF", "HH": "HH"}
    texts = dict.fromkeys(SOILS, "not run")
    for soil in recipe.soils:
        means = table[table["site"] == soil].groupby("detector")["pd"].mean()
        texts[soil] = ", ".join(f"{name} {means[detector]:.2f}" for name, detector in names.items())
    return texts


def run(folder: Path, quick: bool, track: Track, world: str) -> Outcome:
    """Run the lanes of every seed, whose scores stay in ``lanes``, and judge them."""
    recipe = study_recipe(quick, world)
    seeds = range(1, 1 + recipe.study.seeds)
    of_seeds = [
        seed_cases(recipe, folder, seed) for seed in track(seeds, "lanes, seed by seed", len(seeds))
    ]
    path = folder / "lanes" / f"premises-{_key(recipe)}.json"
    premises = read_or_make(path, partial(mine_measures, recipe))
    cases: dict[str, dict[str, list[Case]]] = {}
    tables = {}
    found = []
    for name in SURROUNDINGS:
        cases[name] = {site: [one[name][site] for one in of_seeds] for site in recipe.sites}
        tables[name] = pd_table(recipe, cases[name])
        for finding in findings(recipe, cases[name], premises if name == "open" else None):
            found.append(replace(finding, group=name))
    responses = {
        "with the ramp": point_response(recipe, True),
        "without": point_response(recipe, False),
    }
    pds = pd.concat(tables, names=["world"]).reset_index("world")
    resolution = {name: response.resolution for name, response in responses.items()}
    return Outcome(
        findings=found,
        measured=figures.Measured(recipe, cases, responses, wide_image(recipe, 1)),
        facts=page_facts(recipe, cases, tables, responses),
        tables=page_tables(recipe, cases, tables, found),
        files={"pd.csv": pds.to_csv(index=False)},
        notes={"seeds": len(seeds), "resolution_m": resolution},
    )


def seed_cases(recipe: StudyRecipe, folder: Path, seed: int) -> dict[str, dict[str, Case]]:
    """Return the cases of a seed by surroundings and site, or read them if they are on disk."""
    models = folder / "models" if seed == 1 else None
    key = _key(recipe, seed <= recipe.sweeps.seeds)
    path = folder / "lanes" / f"seed-{seed}-{key}.json"
    cases: dict[str, dict[str, Case]] = read_or_make(
        path, lambda: run_seed(recipe, seed, recipe.study.share, models)
    )
    return cases


def _key(recipe: StudyRecipe, *content: Any) -> str:
    """Return the key of what a recipe measures, whatever the number of its seeds."""
    # Whoever asks for more seeds keeps those that are done.
    left_out: Entries = {"vehicle": True, "study": {"seeds"}, "sweeps": {"seeds"}}
    return key_of(recipe.model_dump(mode="json", exclude=left_out), *content)


def mine_measures(recipe: StudyRecipe) -> Case:
    """Measure what the paper says of mines in dry sand without training: Sec. III-B and Fig. 2.

    Returns
    -------
    dict
        ``signature_humps``, as :func:`signature_humps` of all mines of the lane, clutter-free;
        ``visible``, of every wide image which of its mines are readily visible.
    """
    looks = signature_looks(recipe, "sand", share=1.0)
    cuts = np.concatenate([target_cut(recipe, look) for look in looks])
    images = range(1, 1 + recipe.premises.wide_images)
    visible = [visible_mines(recipe, wide_image(recipe, seed)) for seed in images]
    return {"signature_humps": signature_humps(recipe, cuts), "visible": visible}


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
    sand_cuts: dict[str, Complex128Array] = {}
    response = point_response(recipe, filtered=recipe.image.filter == "ramp")
    # Dry sand comes first: its detector is tried at the other sites.
    for site in sorted(recipe.sites, key=lambda site: site != "sand"):
        bare_looks = signature_looks(recipe, site)
        signatures = np.concatenate([target_cut(recipe, look) for look in bare_looks])
        has_sweeps = site in SOILS and seed <= recipe.sweeps.seeds
        examples = example_looks(recipe, site, seed, share) if has_sweeps else {}
        for surroundings, looks in lane_looks(recipe, site, seed, share).items():
            training = learn(recipe, [look for look in looks if look.trains])
            chip_detectors = detectors(
                recipe, training, signatures.astype(np.complex128), sand_cuts.get(surroundings)
            )
            if site == "sand":
                sand_cuts[surroundings] = training.white
            if has_sweeps:
                chip_detectors |= example_detectors(
                    recipe, site, seed, training, examples[surroundings]
                )
            if models is not None:
                detector = chip_detectors[recipe.main]
                learnt = learnt_of(detector.forms, training.clutter)
                model = Model(stages={"map.deflection": learnt})
                save_model(model, models / f"{site}-{surroundings}", detector.notes)
            peaks = score_looks(recipe, [look for look in looks if not look.trains], chip_detectors)
            if has_sweeps:
                peaks |= one_polarization(recipe, looks)
                peaks |= other_bands(recipe, site, seed, share) if surroundings == "open" else {}
            cases[surroundings][site] = {
                **_lane_case(recipe, looks, training),
                "peaks": {name: asdict(of_detector) for name, of_detector in peaks.items()},
                "point_width": response.resolution[1],
                "site": site,
                "seed": seed,
            }
    return cases


def _lane_case(recipe: StudyRecipe, looks: Sequence[Look], training: Training) -> Case:
    """Return what was measured on a lane beside peaks: premises, eigenvalues and cuts."""
    test = [look for look in looks if not look.trains]
    first_looks = {look.depth: look for look in reversed(looks)}
    cuts = []
    for depth in sorted(first_looks)[:3]:
        magnitude = floats(np.abs(target_cut(recipe, first_looks[depth])[0]))
        cuts.append({"depth": depth, "magnitude": magnitude.tolist()})
    return {
        "premises": look_measures(recipe, test, training.whitener),
        "training_looks": len(looks) - len(test),
        "test_looks": len(test),
        "ratios": eigenvalue_ratios(recipe, training).tolist(),
        "eigenvectors": np.abs(eigenvectors(recipe, training)).tolist(),
        "cuts": cuts,
    }


def _parts(quick: bool) -> list[str]:
    """Return the seeds."""
    return [str(seed) for seed in range(1, 1 + study_recipe(quick).study.seeds)]


def _part(folder: Path, seed: str, quick: bool, world: str) -> None:
    """Run the lanes of a seed, unless they are on disk."""
    seed_cases(study_recipe(quick, world), folder, int(seed))


STUDY = Study("cosgrove2004", "index.html", figures, run, _parts, _part)
