"""Examples of flsar2004: regions about mines and clutter, their features, and held-out scores of the classifiers."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray
from scipy.spatial.distance import pdist
from sklearn import config_context
from sklearn.metrics import roc_auc_score
from sklearn.metrics.pairwise import pairwise_kernels
from sklearn.model_selection import StratifiedKFold
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler
from sklearn.svm import SVC, OneClassSVM

from flgpr.chain.stages import TrainingView
from flgpr.chain.stages.clusters import ClusterScreen, ClusterSettings, TemplateSettings, templates_of
from flgpr.detect import GaussianMixtureNovelty, OneClassRelevanceVectorMachine, RelevanceVectorClassifier
from flgpr.features import (
    align_phases,
    clutter_tiles,
    cut_regions,
    mean_template,
    principal_templates,
    register_fiducials,
    template_features,
)
from flgpr.features.registration import Registration
from flgpr.model import Grid, Lane
from flgpr.scoring import splits
from flgpr.screen.clusters import Rule
from flgpr_papers.flsar2004.lanes import Classify, Pass, Settings

FloatArray = NDArray[np.float64]
POLARIZATIONS = ("HH", "VV")
ANTENNA_HEIGHT = 3.5


@dataclass(frozen=True)
class Site:
    """Both drives at a site, one behind the other in one strip."""

    name: str
    #: (polarization, range, y, x) images; the phase of the way to the pixel at the middle of the band is taken out
    wave: NDArray[np.complex64]
    image: NDArray[np.float32]  #: (polarization, range, y, x) their magnitudes
    grid: Grid  #: pixels of the strip
    #: one row per mine and drive: x, y in the strip, kind, depth, target (the same for both drives), subset
    mines: pd.DataFrame
    lanes: tuple[Lane, ...]  #: the lane in both drives
    registration: dict[str, Registration]  #: of (polarization, range) to the registration by fiducials, drive by drive

    @property
    def view(self) -> xr.DataArray:
        """Magnitudes as the stages of a recipe take them."""
        coords = {"polarization": list(POLARIZATIONS), "y": self.grid.y, "x": self.grid.x}
        return xr.DataArray(self.image, dims=("polarization", "subband", "y", "x"), coords=coords)

    @property
    def area(self) -> float:
        """Area of the lane, counted once per drive, m²."""
        return sum(lane.area for lane in self.lanes)


def join(settings: Settings, drives: Sequence[Pass]) -> Site:
    """Put the drives of a site into one strip and choose the subset for templates and thresholds."""
    first = drives[0].grid
    grid = Grid(first.x_min, first.y_min, first.nx, first.ny * len(drives), first.dx, first.dy)
    mines, lanes, registration = [], [], {}
    for k, one in enumerate(drives):
        offset = k * first.ny * first.dy
        for p, r in np.ndindex(*one.image.shape[:2]):
            # Focused on the ground, what stands higher appears nearer by height·H/distance.
            known = np.array(one.fiducials[["x", "y"]], dtype=np.float64)
            known[:, 1] -= one.fiducials["height"].to_numpy() * ANTENNA_HEIGHT / settings.ranges[r]
            name = f"{one.direction} {POLARIZATIONS[p]} {settings.ranges[r]:g} m"
            registration[name] = register_fiducials(np.abs(one.image[p, r]), one.grid, known)
        shift = np.median([found.shift for key, found in registration.items() if key.startswith(one.direction)], axis=0)
        table = one.truth[["x", "y", "kind", "depth"]].assign(target=one.truth["target_id"], direction=one.direction)
        table["x"] += shift[0]
        table["y"] += shift[1] + offset
        mines.append(table)
        lanes.append(Lane(settings.lane[0], settings.lane[1], offset, settings.length + offset))
    table = pd.concat(mines, ignore_index=True)
    names = np.sort(table["target"].unique())
    rng = np.random.default_rng(settings.seed + settings.sites.index(drives[0].site))
    chosen = rng.choice(names, max(round(settings.features.share * len(names)), 4), replace=False)
    table["subset"] = table["target"].isin(chosen)
    wave = np.concatenate([one.image for one in drives], axis=2)
    return Site(drives[0].site, wave, np.abs(wave), grid, table, tuple(lanes), registration)


def signatures(
    settings: Settings, site: Site, subset: bool, magnitude: bool = True
) -> tuple[NDArray[Any], pd.DataFrame]:
    """Cut images of template size about the mines: those of the subset, or all the others."""
    mines = site.mines[site.mines["subset"] == subset].reset_index(drop=True)
    image = site.image if magnitude else site.wave
    return cut_regions(image, site.grid, mines[["x", "y"]], settings.features.template), mines


@dataclass(frozen=True)
class Variant:
    """A way to make templates and to correlate with them."""

    components: int  #: number of principal components; 0 is the mean
    magnitude: bool  #: whether magnitudes are correlated, or complex values


MAIN = Variant(0, True)
VARIANTS = {
    "mean template, magnitudes": MAIN,
    "first component, magnitudes": Variant(1, True),
    "three components, magnitudes": Variant(3, True),
    "mean template, complex": Variant(0, False),
    "first component, complex": Variant(1, False),
    "three components, complex": Variant(3, False),
}


def make_templates(settings: Settings, site: Site, variant: Variant = MAIN) -> NDArray[Any]:
    """Make templates from the subset's signatures, shape (polarization, range, y, x) or (..., component, y, x).

    Complex signatures have any phase, as mines do not lie where they are surveyed to a part of a wavelength: they are
    turned to one phase before they are averaged.
    """
    if variant == MAIN:
        return templates_of([_training(site)], TemplateSettings(**_sizes(settings)))
    chips = signatures(settings, site, True, variant.magnitude)[0]
    channels = []
    for p, r in np.ndindex(*chips.shape[1:3]):
        one = chips[:, p, r]
        channels.append(
            principal_templates(one, variant.components)[0] if variant.components else mean_template(align_phases(one))
        )
    return np.stack(channels).reshape(*chips.shape[1:3], *channels[0].shape)


def open_examples(
    settings: Settings, site: Site, templates: NDArray[Any], magnitude: bool = True
) -> tuple[pd.DataFrame, FloatArray]:
    """Examples without prescreener: every mine outside the subset, and the tiles of the lane that hold none."""
    features = settings.features
    mines = site.mines[~site.mines["subset"]]
    tiles = [
        clutter_tiles(lane, features.region, site.mines[["x", "y"]], features.keep_off).assign(clutter=f"{k}")
        for k, lane in enumerate(site.lanes)
    ]
    table = pd.concat([mines, pd.concat(tiles).assign(kind="clutter")], ignore_index=True)
    return _with_features(settings, site, templates, table, magnitude)


def _with_features(
    settings: Settings, site: Site, templates: NDArray[Any], table: pd.DataFrame, magnitude: bool = True
) -> tuple[pd.DataFrame, FloatArray]:
    table = table.assign(site=site.name).drop(columns=["clutter", "subset"], errors="ignore")
    table["target"] = table["target"].fillna("") if "target" in table else ""
    image = site.image if magnitude else site.wave
    regions = cut_regions(image, site.grid, table[["x", "y"]], settings.features.region)
    return table, template_features(regions, templates, magnitude)


def learn_screen(settings: Settings, site: Site, kinds: tuple[str, ...] = ("metal",)) -> ClusterScreen:
    """Train the recipe's prescreeners on the subset's mines of some kinds, or all of it if there is none of them."""
    table = ClusterSettings(
        **_sizes(settings), radius=settings.prescreen.radius, pass_share=settings.prescreen.pass_share,
        reach=settings.prescreen.halo, kinds=kinds,
    )  # fmt: skip
    return ClusterScreen(table, None, ClusterScreen.fit(table, [_training(site)])[0])  # type: ignore[arg-type]


def screened_regions(
    site: Site, screen: ClusterScreen, polarizations: Sequence[str], rule: Rule = "and-or"
) -> pd.DataFrame:
    """Regions in the lane that pass in all ranges of a polarization (par. 44), by "and" in all images (par. 18)."""
    table = screen.settings.model_copy(update={"polarizations": tuple(polarizations), "rule": rule})
    regions = ClusterScreen(table, screen.setup, screen.learnt).alarms(site.view)
    inside = np.zeros(len(regions), np.bool_)
    for lane in site.lanes:
        inside |= lane.contains(regions["x"], regions["y"])
    return regions[inside].reset_index(drop=True)


def _training(site: Site) -> TrainingView:
    """Show the site to a stage with the subset's mines alone."""
    return TrainingView(site.view, site.mines[site.mines["subset"]], site.lanes[0])


def _sizes(settings: Settings) -> dict[str, Any]:
    """Sizes that the stages of the recipe are told; all of the subset trains them."""
    return {"region": settings.features.region, "template": settings.features.template, "share": 0.999}


def screened_examples(
    settings: Settings, site: Site, templates: NDArray[Any], regions: pd.DataFrame
) -> tuple[pd.DataFrame, FloatArray]:
    """Label regions by the mines within the halo; further regions of one mine, and those of the subset, are dropped."""
    mines = site.mines.reset_index(drop=True)
    places = mines[["x", "y"]].to_numpy(dtype=np.float64)
    distance = np.linalg.norm(regions[["x", "y"]].to_numpy(dtype=np.float64)[:, None] - places, axis=2)
    nearest = distance.argmin(axis=1)
    near = distance[np.arange(len(regions)), nearest] <= settings.prescreen.halo
    label = mines.iloc[nearest][["kind", "depth", "target", "direction", "subset"]].reset_index(drop=True)
    label.loc[~near, ["kind", "depth", "target", "direction", "subset"]] = ["clutter", np.nan, "", "", False]
    table = pd.concat([regions[["x", "y"]], label], axis=1)
    again = table.duplicated(["target", "direction"]) & (table["target"] != "")
    table = table[~again & ~table["subset"].astype(bool)].reset_index(drop=True)
    return _with_features(settings, site, templates, table)


# Classifiers: functions of training features and labels that return a function of test features, and the share of the
# training examples that the classifier keeps.
Scorer = Callable[[FloatArray], FloatArray]
Classifier = Callable[[FloatArray, NDArray[np.bool_]], tuple[Scorer, float]]


def rvm(settings: Classify, kernel: str = "rbf") -> Classifier:
    """Relevance vector machine with the paper's Laplacian prior (par. 30) on the very kernel of the SVM (par. 48)."""

    def fit(X: FloatArray, y: NDArray[np.bool_]) -> tuple[Scorer, float]:
        chosen = _search(settings, kernel, X, y)[-1].get_params()
        option = {name: chosen[name] for name in ("kernel", "gamma", "degree", "coef0")}
        return _relevance(X, y, prior="laplacian", **option)

    return fit


def evidence_rvm(settings: Classify, kernel: str = "rbf") -> Classifier:
    """Relevance vector machine of our own choice: ARD prior, width by the evidence of the training examples."""

    def fit(X: FloatArray, y: NDArray[np.bool_]) -> tuple[Scorer, float]:
        Z = StandardScaler().fit_transform(X)
        options = [{"kernel": kernel, "gamma": width / X.shape[1]} for width in settings.widths]
        trials = [RelevanceVectorClassifier(n_starts=1, tol=1e-3, **option).fit(Z, y) for option in options]
        return _relevance(X, y, **options[int(np.argmax([trial.log_evidence_ for trial in trials]))])

    return fit


def _relevance(X: FloatArray, y: NDArray[np.bool_], **option: Any) -> tuple[Scorer, float]:
    machine = make_pipeline(StandardScaler(), RelevanceVectorClassifier(n_starts=3, tol=1e-4, **option)).fit(X, y)
    return machine.decision_function, len(machine[-1].relevance_) / len(X)


def svm(settings: Classify, kernel: str = "rbf") -> Classifier:
    """Support vector machine; C and width or degree by cross-validation inside the training examples."""

    def fit(X: FloatArray, y: NDArray[np.bool_]) -> tuple[Scorer, float]:
        best = _search(settings, kernel, X, y).fit(X, y)
        return best.decision_function, len(best[-1].support_) / len(X)

    return fit


def _search(settings: Classify, kernel: str, X: FloatArray, y: NDArray[np.bool_]) -> Any:
    """Choose a support vector machine, and with it the kernel of both machines, inside the training examples.

    By the mean area under the ROC of three folds, whose kernels are computed once for all costs: a grid search of whole
    pipelines takes twice as long.
    """
    if kernel == "rbf":
        options: list[dict[str, float]] = [{"gamma": width / X.shape[1]} for width in settings.widths]
    else:
        options = [{"degree": n, "coef0": 1.0, "gamma": 1 / X.shape[1]} for n in settings.degrees]
    area = np.zeros((len(settings.costs), len(options)))
    with config_context(assume_finite=True, skip_parameter_validation=True):
        for train, test in StratifiedKFold(3, shuffle=True, random_state=0).split(X, y):
            scaler = StandardScaler().fit(X[train])
            seen, new = scaler.transform(X[train]), scaler.transform(X[test])
            for k, option in enumerate(options):
                inner, outer = (pairwise_kernels(Z, seen, kernel, **option) for Z in (seen, new))
                for j, cost in enumerate(settings.costs):
                    machine = SVC(C=cost, kernel="precomputed").fit(inner, y[train])
                    score = machine.decision_function(outer)
                    above = score[y[test]][:, None] - score[~y[test]]
                    area[j, k] += (above > 0).mean() + 0.5 * (above == 0).mean()
    best_cost, best = np.unravel_index(int(area.argmax()), area.shape)
    return make_pipeline(StandardScaler(), SVC(C=settings.costs[best_cost], kernel=kernel, **options[best]))


def median_width(mines: FloatArray) -> float:
    """Give γ so that two mines at the median distance of all pairs of standardised mines have the kernel 1/e."""
    return float(1 / np.median(pdist(StandardScaler().fit_transform(mines), "sqeuclidean")))


def one_class(settings: Classify, kind: str = "rvm") -> Classifier:
    """Novelty detector that is given the training mines only, its width by :func:`median_width`."""

    def fit(X: FloatArray, y: NDArray[np.bool_]) -> tuple[Scorer, float]:
        mines = X[y]
        if kind == "rvm":
            machine = OneClassRelevanceVectorMachine(
                gamma=median_width(mines), prior="laplacian", p0=settings.p0, n_starts=3, tol=1e-4
            ).fit(mines)
            return machine.score_samples, len(machine.relevance_) / len(mines)
        if kind == "svm":
            pipeline = make_pipeline(StandardScaler(), OneClassSVM(nu=0.1, gamma=median_width(mines))).fit(mines)
            return pipeline.decision_function, len(pipeline[-1].support_) / len(mines)
        mixture = GaussianMixtureNovelty(random_state=0).fit(mines)
        return mixture.score_samples, 1.0

    return fit


@dataclass(frozen=True)
class HeldOut:
    """Scores of examples by classifiers that have not seen them."""

    mine: FloatArray  #: (n,) scores of the mines
    clutter: FloatArray  #: (m, repeats) scores of the clutter; a novelty detector scores it in every fold (par. 52)
    #: target, tile: mine that each score belongs to, and name of each clutter example
    target: NDArray[Any]
    tile: NDArray[Any]
    kept: FloatArray  #: (fold,) share of the training examples kept as vectors


def held_out(
    table: pd.DataFrame, X: FloatArray, classifier: Classifier, folds: int | None, novelty: bool = False
) -> HeldOut:
    """Score every example by a classifier trained without its mine; ``folds`` None is the paper's leave-one-out."""
    y = (table["kind"] != "clutter").to_numpy()
    if folds is None:
        groups = splits(table, "example")
    else:
        groups = splits(table, "target", folds=min(folds, len(np.unique(_names(table, y)))))
    if novelty:
        groups = [group for group in groups if y[group.test].any()]
    score = np.full(len(table), np.nan)
    pooled, kept = [], []
    for group in groups:
        scorer, share = classifier(X[group.train], y[group.train])
        score[group.test] = scorer(X[group.test])
        kept.append(share)
        if novelty:
            pooled.append(scorer(X[~y]))
    clutter = np.stack(pooled, axis=1) if novelty else score[~y][:, None]
    return HeldOut(score[y], clutter, _names(table, y), np.arange((~y).sum()).astype(str), np.array(kept))


def retrained(
    table: pd.DataFrame, X: FloatArray, classifier: Classifier, folds: int, draws: int, seed: int = 0
) -> FloatArray:
    """Area under the ROC (draw,) with mines and clutter drawn anew and the classifier trained on what was drawn.

    Looks at one mine are drawn together, and all copies of an example are held out together.
    """
    rng, found = np.random.default_rng(seed), []
    y = (table["kind"] != "clutter").to_numpy()
    mines = [np.flatnonzero(table["target"].to_numpy(dtype=str) == name) for name in np.unique(_names(table, y))]
    for _ in range(draws):
        chosen = [mines[k] for k in rng.integers(len(mines), size=len(mines))]
        rows = np.concatenate([*chosen, rng.choice(np.flatnonzero(~y), int((~y).sum()))])
        names = np.where(y[rows], table["target"].to_numpy(dtype=str)[rows], np.char.add("clutter ", rows.astype(str)))
        group = np.unique(names, return_inverse=True)[1]
        fold = rng.permutation(group.max() + 1) % folds
        score = np.full(len(rows), np.nan)
        for k in range(folds):
            test = fold[group] == k
            score[test] = classifier(X[rows][~test], y[rows][~test])[0](X[rows][test])
        found.append(roc_auc_score(y[rows], score))
    return np.array(found)


def across(
    train: tuple[pd.DataFrame, FloatArray], test: tuple[pd.DataFrame, FloatArray], classifier: Classifier
) -> HeldOut:
    """Train on one site and test on the other (par. 39)."""
    y, z = ((table["kind"] != "clutter").to_numpy() for table, _ in (train, test))
    scorer, share = classifier(train[1], y)
    score = scorer(test[1])
    tiles = np.arange((~z).sum()).astype(str)
    return HeldOut(score[z], score[~z][:, None], _names(test[0], z), tiles, np.array([share]))


def _names(table: pd.DataFrame, mine: NDArray[np.bool_]) -> NDArray[Any]:
    return table["target"].to_numpy(dtype=str)[mine]
