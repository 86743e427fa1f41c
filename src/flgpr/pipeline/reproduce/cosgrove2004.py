"""The study of Cosgrove et al. 2004 on simulated lanes: sites, training, detectors, figures, findings."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from dataclasses import asdict
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from flgpr.io import write_whole
from flgpr.pipeline.progress import Track, silent
from flgpr.pipeline.reproduce import cosgrove2004_figures as figures
from flgpr.pipeline.reproduce.cosgrove2004_detect import (
    detectors,
    eigenvalue_ratios,
    eigenvectors,
    learn,
    score_looks,
    target_cut,
)
from flgpr.pipeline.reproduce.cosgrove2004_examples import PointResponse, point_response, signature_cuts, wide_image
from flgpr.pipeline.reproduce.cosgrove2004_findings import (
    Case,
    as_records,
    findings,
    pd_table,
)
from flgpr.pipeline.reproduce.cosgrove2004_images import Look, lane_looks
from flgpr.pipeline.reproduce.cosgrove2004_page import page_html
from flgpr.pipeline.reproduce.cosgrove2004_recipe import StudyRecipe, study_recipe

ComplexArray = NDArray[np.complex128]
Cases = Mapping[str, Sequence[Case]]
Job = tuple[str, int]
_SIGNATURE_SEEDS = 10_000
_SIGNATURE_SHARE = 0.2


def reproduce(
    output: str | Path,
    quick: bool = False,
    track: Track = silent,
    recipe: StudyRecipe | None = None,
    workers: int = 1,
) -> Path:
    """Run the study and write its page, figures, findings and trained detectors.

    Every lane's scores are kept in ``output/lanes``, so that a broken run goes on where it stopped.

    Parameters
    ----------
    output : path
        Folder to make or to go on with.
    quick : bool
        Fewer seeds and mines; everything shown is marked as such.
    track : Track
        Shows progress.
    recipe : StudyRecipe, optional
        Study in place of the packaged one.
    workers : int
        Number of processes that simulate lanes.

    Returns
    -------
    Path
        The page, ``index.html``.
    """
    study = recipe or study_recipe()
    folder = Path(output)
    (folder / "lanes").mkdir(parents=True, exist_ok=True)
    seeds = range(1, 1 + (study.study.quick_seeds if quick else study.study.seeds))
    share = study.study.quick_share if quick else 1.0
    cases = _run_cases(study, folder, seeds, share, track, workers)
    table = pd_table(study, cases)
    found = findings(study, cases, table)
    responses = {"with the ramp": point_response(study, True), "without": point_response(study, False)}
    drawn = _figures(study, cases, responses, seeds[0])
    for name, figure in drawn.items():
        if quick:
            figure.text(0.5, 0.5, "QUICK", fontsize=60, color="#d33", alpha=0.15, ha="center", va="center", rotation=20)
        figure.savefig(folder / f"{name}.png", dpi=130, metadata={"Software": None})
    table.to_csv(folder / "pd.csv", index=False)
    summary = {
        "quick": quick,
        "seeds": len(seeds),
        "resolution_m": {name: response.resolution for name, response in responses.items()},
        "findings": as_records(found),
    }
    write_whole(folder / "findings.json", json.dumps(summary, indent=2) + "\n")
    page = folder / "index.html"
    write_whole(page, page_html(study, cases, table, found, responses, drawn, quick))
    return page


def run_lane(
    recipe: StudyRecipe,
    site: str,
    seed: int,
    share: float,
    other: ComplexArray | None = None,
    models: Path | None = None,
) -> Case:
    """Simulate one lane, train on it and score every detector.

    Parameters
    ----------
    recipe : StudyRecipe
        The study.
    site : str
        Its name.
    seed : int
        Seed of the lane.
    share : float
        Share of the mines that are laid.
    other : (n_samples, n_features) ndarray of complex, optional
        Whitened training cuts of another lane, for the detector trained there.
    models : Path, optional
        Folder to save the deflection detector in.

    Returns
    -------
    case
        Plain values: peaks by detector, eigenvalue ratios, eigenvectors, cuts, numbers of looks.
    """
    looks = lane_looks(recipe, site, seed, share)
    trains, test = [look for look in looks if look.trains], [look for look in looks if not look.trains]
    training = learn(recipe, trains)
    # Other mines than those of the lane, as few as give every depth.
    bare = lane_looks(recipe, site, seed + _SIGNATURE_SEEDS, _SIGNATURE_SHARE, clean=True)
    signatures = np.concatenate([target_cut(recipe, look) for look in bare]).astype(np.complex128)
    made = detectors(recipe, training, signatures, other)
    if models is not None:
        made[f"rank {recipe.detector.rank}"].save(models / site)
    return {
        "site": site,
        "seed": seed,
        "training_looks": len(trains),
        "test_looks": len(test),
        "ratios": eigenvalue_ratios(recipe, training).tolist(),
        "eigenvectors": np.abs(eigenvectors(recipe, training)).tolist(),
        "white": [training.white.real.tolist(), training.white.imag.tolist()],
        "cuts": [_sample_cut(recipe, look) for look in _one_per_depth(looks)],
        "peaks": {name: asdict(peaks) for name, peaks in score_looks(recipe, test, made).items()},
    }


def _run_cases(
    recipe: StudyRecipe, folder: Path, seeds: range, share: float, track: Track, workers: int
) -> dict[str, list[Case]]:
    """Run what is not yet on disk: dry sand first, since the other lanes also try the detector trained there."""
    key = hashlib.sha256(f"{recipe.model_dump_json()} {share}".encode()).hexdigest()[:12]
    others = [site for site in recipe.sites if site != "sand"]
    cases: dict[str, list[Case]] = {}
    trained: list[ComplexArray | None] = [None] * len(seeds)
    for sites, label in ((["sand"], "dry sand"), (others, "other lanes")):
        jobs = [(site, k) for k in range(len(seeds)) for site in sites]
        paths = {job: folder / "lanes" / f"{job[0]}-{seeds[job[1]]}-{key}.json" for job in jobs}
        todo = {
            (site, k): (recipe, site, seeds[k], share, trained[k], folder / "models" if k == 0 else None)
            for site, k in jobs
            if not paths[site, k].is_file()
        }
        with _executor(workers) as run:
            for job, case in track(run(todo), label, len(todo)):
                write_whole(paths[job], json.dumps(case))
        cases |= {site: [json.loads(paths[site, k].read_text("utf-8")) for k in range(len(seeds))] for site in sites}
        if sites == ["sand"]:
            trained = [np.array(case["white"][0]) + 1j * np.array(case["white"][1]) for case in cases["sand"]]
    return {site: cases[site] for site in recipe.sites}


@contextmanager
def _executor(workers: int) -> Iterator[Callable[[Mapping[Job, tuple[Any, ...]]], Iterator[tuple[Job, Case]]]]:
    """Give a function that runs jobs and yields what each makes, here or in processes."""
    if workers == 1:
        yield lambda jobs: ((job, run_lane(*values)) for job, values in jobs.items())
        return
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:

        def run(jobs: Mapping[Job, tuple[Any, ...]]) -> Iterator[tuple[Job, Case]]:
            futures = {pool.submit(run_lane, *values): job for job, values in jobs.items()}
            return ((futures[done], done.result()) for done in as_completed(futures))

        yield run


def _one_per_depth(looks: Sequence[Look]) -> list[Look]:
    first: dict[float, Look] = {}
    for look in looks:
        first.setdefault(look.depth, look)
    return [first[depth] for depth in sorted(first)][:3]


def _sample_cut(recipe: StudyRecipe, look: Look) -> dict[str, Any]:
    cut = np.abs(target_cut(recipe, look)[0]).astype(np.float64)
    return {"depth": look.depth, "magnitude": cut.tolist()}


def _figures(recipe: StudyRecipe, cases: Cases, responses: Mapping[str, PointResponse], seed: int) -> dict[str, Figure]:
    image = wide_image(recipe, seed)
    sand = cases["sand"][0]
    magnitudes: NDArray[np.float64] = np.array(sand["eigenvectors"])
    return {
        "figure-1": figures.geometry(recipe),
        "figure-2": figures.sample_image(image),
        "figure-3": figures.simulated_signature(*signature_cuts(recipe)),
        "figure-4": figures.imaged_signatures(recipe, sand["cuts"]),
        "figure-5": figures.feature_vector(recipe, image),
        "figure-6": figures.eigenvector_figure(recipe, magnitudes, np.array(sand["ratios"])),
        "figure-7": figures.roc_figure(recipe, cases),
        "resolution": figures.point_figure(responses),
        "depth": figures.depth_figure(recipe, cases),
    }
