"""Train and score the detectors of the study on the images of one lane."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import product

import numpy as np

from flgpr.clutter import ClutterWhitener
from flgpr.detect import (
    ChipDetector,
    DeflectionDetector,
    LinearQuadraticForm,
    NeymanPearsonDetector,
    PolarimetricWhiteningFilter,
    deflection_form,
    magnitude_form,
)
from flgpr.features import range_cuts, stack_channels
from flgpr.kernels.moments import LEAST_OGK, sample_moments
from flgpr.model import Lane
from flgpr.scoring import offset_boxes
from flgpr.stages.forms import samples_at
from flgpr.types import (
    AnyArray,
    Complex128Array,
    ComplexArray,
    Entries,
    Float32Array,
    FloatArray,
)
from flgpr_papers.cosgrove2004.images import Look, lane_looks, lane_seed
from flgpr_papers.cosgrove2004.recipe import StudyRecipe

FORMS = ("deflection", "Neyman-Pearson")
"""Detectors that are trained on the same examples."""
_OTHER_LANE = 500  # seeds from here on are of the lanes from which examples come


def example_name(form: str, rank: int, number: int) -> str:
    """Return the name of a detector that is trained on a number of examples."""
    return f"{form} of rank {rank}, {number} examples"


def alone(polarization: str) -> str:
    """Return the name of the deflection detector of one polarization."""
    return f"{polarization} cuts alone"


def example_looks(
    recipe: StudyRecipe, site: str, seed: int, share: float = 1.0
) -> dict[str, list[Look]]:
    """Image further training mines of a site, on a lane of their own; as :func:`lane_looks`."""
    of_site = recipe.sites[site]
    # Two stops at least: the self-signature is a mean over them.
    training = dict.fromkeys(of_site.training, max(2, round(recipe.sweeps.mines * share)))
    more_mines = of_site.model_copy(update={"training": training, "test": {}})
    other = recipe.model_copy(update={"sites": {**recipe.sites, site: more_mines}})
    return lane_looks(other, site, seed + _OTHER_LANE)


def example_detectors(
    recipe: StudyRecipe, site: str, seed: int, training: Training, looks: Sequence[Look]
) -> dict[str, ChipDetector]:
    """Return the detectors trained on more and fewer examples, at every rank.

    Parameters
    ----------
    recipe : StudyRecipe
        The study.
    site, seed
        Of the lane under test; they fix the order in which examples are taken.
    training : Training
        Of the lane under test, whose clutter whitens the examples.
    looks : sequence of Look
        The examples.
    """
    cuts = training.whitener.transform(np.concatenate([target_cut(recipe, x) for x in looks]))
    order = np.random.default_rng([lane_seed(recipe, site, seed), 36]).permutation(len(cuts))
    trained = {}
    for number, rank in product(recipe.sweeps.numbers, recipe.sweeps.ranks):
        if number > len(cuts):
            continue
        detectors = (DeflectionDetector(rank, recipe.detector.ddof), NeymanPearsonDetector(rank))
        for form, detector in zip(FORMS, detectors, strict=True):
            forms = detector.fit(cuts[order[:number]]).forms_
            trained[example_name(form, rank, number)] = chip_detector(
                recipe, forms, training.whitener, recipe.cut.length
            )
    return trained


def one_polarization(recipe: StudyRecipe, looks: Sequence[Look]) -> dict[str, Peaks]:
    """Train and score the deflection detector on the cuts of each polarization by itself."""
    peaks: dict[str, Peaks] = {}
    for name in recipe.cut.polarizations:
        cut = recipe.cut.model_copy(update={"polarizations": (name,)})
        peaks |= deflection_peaks(recipe.model_copy(update={"cut": cut}), looks, alone(name))
    return peaks


def other_bands(
    recipe: StudyRecipe,
    site: str,
    seed: int,
    share: float,
    parts: Mapping[str, Entries] | None = None,
) -> dict[str, Peaks]:
    """Train and score the deflection detector on images of the open lane in several bands.

    The parameters are those of :func:`lane_looks`.
    """
    peaks: dict[str, Peaks] = {}
    for name, looks in lane_looks(recipe, site, seed, share, recipe.sweeps.bands, parts).items():
        peaks |= deflection_peaks(recipe, looks, name)
    return peaks


def deflection_peaks(recipe: StudyRecipe, looks: Sequence[Look], name: str) -> dict[str, Peaks]:
    """Train the deflection detector on the training looks and score it, by name, on the others."""
    training = learn(recipe, [look for look in looks if look.trains])
    detector = DeflectionDetector(recipe.detector.rank, recipe.detector.ddof).fit(training.white)
    made = chip_detector(recipe, detector.forms_, training.whitener, recipe.cut.length)
    return score_looks(recipe, [look for look in looks if not look.trains], {name: made})


@dataclass(frozen=True)
class Training:
    """What a lane's training looks teach."""

    whitener: ClutterWhitener  #: mean and covariance of the clutter
    #: (n_samples, n_features) whitened target cuts, taken where the mines are brightest
    white: Complex128Array
    #: (n_samples, n_features) whitened target cuts, taken where survey and refraction place the
    #: mines
    surveyed: Complex128Array
    pixels: Complex128Array  #: (n_pixels, n_polarizations) clutter pixels
    unshrunk: ClutterWhitener  #: whitener with sample moments
    clutter_energy: float  #: mean energy of the whitened clutter samples
    clutter: AnyArray  #: (n_samples, n_features) clutter cuts as imaged


@dataclass
class Peaks:
    """Values in boxes of one detector on one lane."""

    target: list[float] = field(default_factory=list)  #: peaks in the boxes at the mines
    clutter: list[float] = field(default_factory=list)  #: peaks in the boxes away from them
    target_quantile: list[float] = field(default_factory=list)  #: high quantiles at the mines
    clutter_quantile: list[float] = field(default_factory=list)  #: high quantiles away from them
    depth: list[float] = field(default_factory=list)  #: depth of each mine, m
    rock: list[bool] = field(default_factory=list)  #: whether a rock is in or near a clutter box


def learn(recipe: StudyRecipe, looks: Sequence[Look]) -> Training:
    """Take target cuts and clutter from training looks and whiten them.

    Parameters
    ----------
    recipe : StudyRecipe
        The study.
    looks : sequence of Look
        The training looks of a lane.
    """
    shape = (recipe.cut.length, 1)
    samples = [samples_at(look.image, look.position[None], recipe.cuts) for look in looks]
    surveyed_cuts = []
    for look in looks:
        surveyed = (look.position + [0.0, look.shift])[None]
        surveyed_cuts.append(range_cuts(look.image, surveyed, shape, recipe.cut.polarizations))
    clutter = np.concatenate([of_look.clutter for of_look in samples])
    whitener = ClutterWhitener(recipe.training.moments).fit(clutter)
    unshrunk = ClutterWhitener("sample").fit(clutter)
    energy = np.sum(np.abs(whitener.transform(clutter)) ** 2, axis=1)
    return Training(
        whitener=whitener,
        white=whitener.transform(np.concatenate([of_look.target for of_look in samples])),
        surveyed=whitener.transform(np.concatenate(surveyed_cuts)),
        pixels=np.concatenate([of_look.pixel for of_look in samples]).astype(np.complex128),
        unshrunk=unshrunk,
        clutter_energy=float(np.mean(energy)),
        clutter=clutter,
    )


def target_cut(recipe: StudyRecipe, look: Look) -> ComplexArray:
    """Return the range cut (1, n_features) through a mine where it appears."""
    shape = (recipe.cut.length, 1)
    names = recipe.cut.polarizations
    return range_cuts(look.image, look.position[None], shape, names, recipe.training.search)


def chip_detector(
    recipe: StudyRecipe,
    forms: Sequence[LinearQuadraticForm],
    whitener: ClutterWhitener | None,
    length: int,
    **notes: str,
) -> ChipDetector:
    """Return a detector of whitening and forms.

    Parameters
    ----------
    recipe : StudyRecipe
        The study.
    forms : sequence of LinearQuadraticForm
        Forms of whitened cuts.
    whitener : ClutterWhitener or None
        None for forms that act on pixels as imaged.
    length : int
        Length of a cut, pixels.
    **notes
        What is stored with the detector.
    """
    if whitener is not None:
        forms = [form.after(whitener.mean_, whitener.matrix_) for form in forms]
    dx, dy = recipe.image.spacing
    return ChipDetector(tuple(forms), recipe.cut.polarizations, (length, 1), (dy, dx), dict(notes))


def detectors(
    recipe: StudyRecipe,
    training: Training,
    signatures: Complex128Array | None = None,
    sand_cuts: Complex128Array | None = None,
) -> dict[str, ChipDetector]:
    """Return every detector of the study for one lane, by name.

    Parameters
    ----------
    recipe : StudyRecipe
        The study.
    training : Training
        What the lane's training looks teach.
    signatures : (n_samples, n_features) ndarray, optional
        Cuts of simulated mines, for the detector "trained on simulation".
    sand_cuts : (n_samples, n_features) ndarray, optional
        Whitened target cuts of dry sand, for the detector "trained on sand".

    Returns
    -------
    dict
        ``HH``, ``VV``, ``PWF``, ``rank 1`` and more.
    """
    length = recipe.cut.length
    whitener = training.whitener
    rank = recipe.detector.rank
    polarizations = recipe.cut.polarizations
    chip_detectors = {}
    for k, name in enumerate(polarizations):
        form = magnitude_form(len(polarizations), k)
        chip_detectors[name] = chip_detector(recipe, [form], None, 1)
    pwf = PolarimetricWhiteningFilter().fit(training.pixels)
    chip_detectors["PWF"] = chip_detector(recipe, pwf.forms_, None, 1)
    if signatures is not None:
        mean, covariance = sample_moments(calibrated(training, signatures))
        form = deflection_form(mean, covariance, rank=rank)
        chip_detectors["trained on simulation"] = chip_detector(recipe, [form], whitener, length)
    # The target cuts, whitened by sample moments instead.
    back = np.linalg.solve(whitener.matrix_, training.white.T).T + whitener.mean_
    rewhitened = training.unshrunk.transform(back)
    unshrunk = DeflectionDetector(rank, recipe.detector.ddof).fit(rewhitened)
    chip_detectors["unshrunk clutter"] = chip_detector(
        recipe, unshrunk.forms_, training.unshrunk, length, detector=repr(unshrunk)
    )
    for name, detector in _cut_detectors(recipe, training, sand_cuts).items():
        chip_detectors[name] = chip_detector(
            recipe, detector.forms_, whitener, length, detector=repr(detector)
        )
    return chip_detectors


def _cut_detectors(
    recipe: StudyRecipe, training: Training, sand_cuts: Complex128Array | None
) -> dict[str, DeflectionDetector | NeymanPearsonDetector]:
    """Return the detectors of whitened cuts: the ranks of the study, and what is tried beside."""
    white = training.white
    rank = recipe.detector.rank
    ddof = recipe.detector.ddof
    trained: dict[str, DeflectionDetector | NeymanPearsonDetector] = {}
    for number in recipe.detector.ranks:
        trained[f"rank {number}"] = DeflectionDetector(number, ddof).fit(white)
    trained["matched filter"] = DeflectionDetector(0, ddof).fit(white)
    trained["Neyman-Pearson"] = NeymanPearsonDetector(rank).fit(white)
    trained["gamma 0.5"] = DeflectionDetector(rank, ddof, gamma=0.5).fit(white)
    trained["placed by survey"] = DeflectionDetector(rank, ddof).fit(training.surveyed)
    trained["clipped"] = DeflectionDetector(rank, moments="clipped").fit(white)
    if len(white) >= LEAST_OGK:
        trained["robust"] = DeflectionDetector(rank, moments="ogk").fit(white)
    if sand_cuts is not None:
        trained["trained on sand"] = DeflectionDetector(rank, ddof).fit(sand_cuts)
    return trained


def calibrated(training: Training, signatures: Complex128Array) -> Complex128Array:
    """Whiten simulated signatures and scale them to the examples' mean energy over the clutter.

    Parameters
    ----------
    training : Training
        What a lane's training looks teach.
    signatures : (n_samples, n_features) ndarray
        Cuts of simulated mines.
    """
    white = signatures @ training.whitener.matrix_.T
    energy = float(np.mean(np.sum(np.abs(training.white) ** 2, axis=1))) - training.clutter_energy
    white *= np.sqrt(max(energy, 1.0) / np.mean(np.sum(np.abs(white) ** 2, axis=1)))
    return white


def score_looks(
    recipe: StudyRecipe, looks: Sequence[Look], chip_detectors: dict[str, ChipDetector]
) -> dict[str, Peaks]:
    """Return the peaks of every detector in the boxes of test looks.

    Parameters
    ----------
    recipe : StudyRecipe
        The study.
    looks : sequence of Look
        The test looks of a lane.
    chip_detectors : dict of ChipDetector
        Detectors by name.
    """
    peaks = {name: Peaks() for name in chip_detectors}
    score = recipe.score
    half_step = recipe.radar.stop_spacing / 2
    ahead = recipe.radar.range
    area = Lane(*recipe.image.x, ahead - half_step, ahead + half_step)
    for look in looks:
        stack, _ = stack_channels(look.image, recipe.cut.polarizations)
        x = look.image["x"].values
        y = look.image["y"].values
        mine_box = look.position[None]
        clutter_boxes = offset_boxes(mine_box, area, score.box, score.clearance)
        distance = np.abs(clutter_boxes[:, None] - look.rocks[None]).max(axis=-1)
        has_rock = (distance <= score.box / 2 + score.rock).any(axis=1)
        for name, detector in chip_detectors.items():
            value = detector.likelihood(stack)
            scores = peaks[name]
            for boxes, peak, high in (
                (mine_box, scores.target, scores.target_quantile),
                (clutter_boxes, scores.clutter, scores.clutter_quantile),
            ):
                values = box_values(value, x, y, boxes, score.box, score.quantile)
                peak += values[0].tolist()
                high += values[1].tolist()
            scores.depth.append(look.depth)
            scores.rock += has_rock.tolist()
    return peaks


def box_values(
    image: Float32Array,
    x: FloatArray,
    y: FloatArray,
    centre: FloatArray,
    box: float,
    quantile: float,
) -> tuple[FloatArray, FloatArray]:
    """Return the peak and a quantile (box,) of a map in boxes.

    Parameters
    ----------
    image : (y, x) ndarray
        The map; NaN pixels are left out.
    x, y : (n,) ndarray
        Axes of the map, m.
    centre : (box, 2) ndarray
        Centres of the boxes, m.
    box : float
        Side of a box, m.
    quantile : float
        Probability of the quantile.

    Returns
    -------
    peak, quantile : (box,) ndarray
        NaN for a box without any other pixel than NaN.
    """
    peak, high = np.full((2, len(centre)), np.nan)
    for number, (px, py) in enumerate(centre):
        columns = slice(*np.searchsorted(x, [px - box / 2, px + box / 2]))
        rows = slice(*np.searchsorted(y, [py - box / 2, py + box / 2]))
        inside = image[rows, columns]
        inside = inside[np.isfinite(inside)]
        if inside.size:
            peak[number] = inside.max()
            high[number] = _quantile(inside, quantile)
    return peak, high


def _quantile(values: Float32Array, share: float) -> float:
    """Return a quantile by linear interpolation; for small arrays much quicker than NumPy's."""
    below, fraction = divmod(share * (values.size - 1), 1)
    k = int(below)
    neighbours = [k, min(k + 1, values.size - 1)]
    low, high = np.partition(values, neighbours)[neighbours]
    return float(low + fraction * (high - low))


def eigenvalue_ratios(
    recipe: StudyRecipe, training: Training, cuts: Complex128Array | None = None
) -> FloatArray:
    """Return the largest six eigenvalues of Â over the first (Cosgrove et al. 2004, Sec. IV-A).

    Parameters
    ----------
    recipe : StudyRecipe
        The study.
    training : Training
        What a lane's training looks teach.
    cuts : (n_samples, n_features) ndarray, optional
        Whitened target cuts; those of the training by default.

    Returns
    -------
    (6,) ndarray
        NaN in directions that no example reaches.
    """
    examples = training.white if cuts is None else cuts
    detector = DeflectionDetector(ddof=recipe.detector.ddof).fit(examples)
    sigma = detector.eigenvalues_.copy()
    sigma[sigma.size - int(detector.n_unseen_) :] = np.nan
    return sigma[:6] / sigma[0]


def eigenvectors(recipe: StudyRecipe, training: Training) -> Complex128Array:
    """Return the first six eigenvectors (6, n_features) of Â, whitening undone, of norm one.

    See Cosgrove et al. 2004, Fig. 6.
    """
    detector = DeflectionDetector(6, recipe.detector.ddof).fit(training.white)
    vectors = detector.forms_[0].vectors
    rows = np.linalg.solve(training.whitener.matrix_, vectors.T).T
    return rows / np.linalg.norm(rows, axis=1, keepdims=True)
