"""Training and scoring of the study's detectors on the images of one lane."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flgpr.chain.stages.forms import samples_at
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
from flgpr.scoring import offset_boxes
from flgpr_papers.cosgrove2004.images import Look
from flgpr_papers.cosgrove2004.recipe import StudyRecipe

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]


@dataclass(frozen=True)
class Training:
    """What a lane's training looks teach."""

    whitener: ClutterWhitener  #: mean and covariance of the clutter
    #: (n_samples, n_features) whitened target cuts, taken where the mines are brightest
    white: ComplexArray
    #: (n_samples, n_features) whitened target cuts, taken where survey and refraction place the
    #: mines
    surveyed: ComplexArray
    pixels: ComplexArray  #: (n_pixels, n_polarizations) clutter pixels
    unshrunk: ClutterWhitener  #: whitener with sample moments
    clutter_energy: float  #: mean energy of the whitened clutter samples
    clutter: NDArray[Any]  #: (n_samples, n_features) clutter cuts as imaged


@dataclass
class Peaks:
    """Values in boxes of one detector on one lane."""

    #: target, clutter: peaks in the boxes at the mines and off them
    target: list[float] = field(default_factory=list)
    clutter: list[float] = field(default_factory=list)
    #: target_quantile, clutter_quantile: high quantiles of the same boxes
    target_quantile: list[float] = field(default_factory=list)
    clutter_quantile: list[float] = field(default_factory=list)
    depth: list[float] = field(default_factory=list)  #: depth of each mine, m
    rock: list[bool] = field(
        default_factory=list
    )  #: whether a rock lies in or near each clutter box


def learn(recipe: StudyRecipe, looks: Sequence[Look]) -> Training:
    """Take target cuts and clutter from training looks and whiten them."""
    shape = (recipe.cut.length, 1)
    taken = [samples_at(look.image, look.place[None], recipe.cuts) for look in looks]
    cuts, clutter, pixels = zip(*taken, strict=True)
    surveyed = [
        range_cuts(
            look.image, (look.place + [0.0, look.shift])[None], shape, recipe.cut.polarizations
        )
        for look in looks
    ]
    samples = np.concatenate(clutter)
    whitener, unshrunk = (
        ClutterWhitener(name).fit(samples) for name in (recipe.training.moments, "sample")
    )
    energy = float(np.mean(np.sum(np.abs(whitener.transform(samples)) ** 2, axis=1)))
    white, placed = (whitener.transform(np.concatenate(arrays)) for arrays in (cuts, surveyed))
    return Training(
        whitener,
        white,
        placed,
        np.concatenate(pixels).astype(np.complex128),
        unshrunk,
        energy,
        samples,
    )


def target_cut(recipe: StudyRecipe, look: Look) -> NDArray[np.complex64]:
    """Range cut through a mine where it appears, (1, n_features)."""
    shape = (recipe.cut.length, 1)
    return range_cuts(
        look.image, look.place[None], shape, recipe.cut.polarizations, recipe.training.search
    )


def chip_detector(
    recipe: StudyRecipe,
    forms: Sequence[LinearQuadraticForm],
    whitener: ClutterWhitener | None,
    length: int,
    **notes: str,
) -> ChipDetector:
    """Put whitening and forms together; without a whitener the forms act on pixels as imaged."""
    if whitener is not None:
        forms = [form.after(whitener.mean_, whitener.matrix_) for form in forms]
    dx, dy = recipe.image.spacing
    return ChipDetector(tuple(forms), recipe.cut.polarizations, (length, 1), (dy, dx), dict(notes))


def detectors(
    recipe: StudyRecipe,
    training: Training,
    signatures: ComplexArray | None = None,
    other: ComplexArray | None = None,
) -> dict[str, ChipDetector]:
    """Make every detector of the study for one lane, by name.

    ``HH``, ``VV``, ``PWF``, ``rank 1`` and more.
    """
    length = recipe.cut.length
    whitener = training.whitener
    white = training.white
    ddof = recipe.detector.ddof
    rank = recipe.detector.rank
    channels = len(recipe.cut.polarizations)
    chip_detectors = {
        name: chip_detector(recipe, [magnitude_form(channels, k)], None, 1)
        for k, name in enumerate(recipe.cut.polarizations)
    }
    chip_detectors["PWF"] = chip_detector(
        recipe, PolarimetricWhiteningFilter().fit(training.pixels).forms_, None, 1
    )
    trained = {f"rank {r}": DeflectionDetector(r, ddof).fit(white) for r in recipe.detector.ranks}
    trained |= {
        "matched filter": DeflectionDetector(0, ddof).fit(white),
        "Neyman-Pearson": NeymanPearsonDetector(rank).fit(white),
        "gamma 0.5": DeflectionDetector(rank, ddof, gamma=0.5).fit(white),
        "placed by survey": DeflectionDetector(rank, ddof).fit(training.surveyed),
        "clipped": DeflectionDetector(rank, moments="clipped").fit(white),
    }
    if len(white) >= LEAST_OGK:
        trained["robust"] = DeflectionDetector(rank, moments="ogk").fit(white)
    if other is not None:
        trained["trained on sand"] = DeflectionDetector(rank, ddof).fit(other)
    if signatures is not None:
        mean, covariance = sample_moments(calibrated(training, signatures))
        form = deflection_form(mean, covariance, rank=rank)
        chip_detectors["trained on simulation"] = chip_detector(recipe, [form], whitener, length)
    deflection = DeflectionDetector(rank, ddof).fit(_rewhitened(training))
    chip_detectors["unshrunk clutter"] = chip_detector(
        recipe, deflection.forms_, training.unshrunk, length, detector=repr(deflection)
    )
    for name, detector in trained.items():
        chip_detectors[name] = chip_detector(
            recipe, detector.forms_, whitener, length, detector=repr(detector)
        )
    return chip_detectors


def _rewhitened(training: Training) -> ComplexArray:
    """Target cuts whitened by sample moments instead."""
    back = np.linalg.solve(training.whitener.matrix_, training.white.T).T + training.whitener.mean_
    return np.asarray(training.unshrunk.transform(back))


def calibrated(training: Training, signatures: ComplexArray) -> ComplexArray:
    """Scale simulated signatures to the examples' mean energy over the clutter, and whiten them."""
    white = signatures @ training.whitener.matrix_.T
    energy = float(np.mean(np.sum(np.abs(training.white) ** 2, axis=1))) - training.clutter_energy
    white *= np.sqrt(max(energy, 1.0) / np.mean(np.sum(np.abs(white) ** 2, axis=1)))
    return np.asarray(white)


def score_looks(
    recipe: StudyRecipe, looks: Sequence[Look], made: dict[str, ChipDetector]
) -> dict[str, Peaks]:
    """Take the peaks of every detector in the boxes of test looks."""
    peaks = {name: Peaks() for name in made}
    score = recipe.score
    half = recipe.radar.stop_spacing / 2
    area = {
        "x_min": recipe.image.x[0],
        "x_max": recipe.image.x[1],
        "y_min": recipe.radar.range - half,
        "y_max": recipe.radar.range + half,
    }
    for look in looks:
        stack, _ = stack_channels(look.image, recipe.cut.polarizations)
        x = look.image["x"].values
        y = look.image["y"].values
        off = offset_boxes(look.place[None], area, score.box, score.clearance)
        apart = np.abs(off[:, None] - look.rocks[None]).max(axis=-1)
        rock = (apart <= score.box / 2 + score.rock).any(axis=1)
        for name, detector in made.items():
            value = detector.likelihood(stack)
            at, high = box_values(value, x, y, look.place[None], score.box, score.quantile)
            around, high_around = box_values(value, x, y, off, score.box, score.quantile)
            scores = peaks[name]
            scores.target += at.tolist()
            scores.target_quantile += high.tolist()
            scores.clutter += around.tolist()
            scores.clutter_quantile += high_around.tolist()
            scores.depth.append(look.depth)
            scores.rock += rock.tolist()
    return peaks


def box_values(
    image: NDArray[np.float32],
    x: FloatArray,
    y: FloatArray,
    centre: FloatArray,
    box: float,
    quantile: float,
) -> tuple[FloatArray, FloatArray]:
    """Peak and quantile of a map in boxes (box, 2).

    NaN pixels are left out, NaN for a box without any other.
    """
    peak = np.full(len(centre), np.nan)
    high = np.full(len(centre), np.nan)
    for number, (px, py) in enumerate(centre):
        columns = slice(*np.searchsorted(x, [px - box / 2, px + box / 2]))
        rows = slice(*np.searchsorted(y, [py - box / 2, py + box / 2]))
        inside = image[rows, columns]
        inside = inside[np.isfinite(inside)]
        if inside.size:
            peak[number] = inside.max()
            high[number] = _quantile(inside, quantile)
    return peak, high


def _quantile(values: NDArray[np.float32], share: float) -> float:
    """Return a quantile by linear interpolation.

    For small arrays this is much quicker than NumPy's.
    """
    below, fraction = divmod(share * (values.size - 1), 1)
    k = int(below)
    low, high = np.partition(values, [k, min(k + 1, values.size - 1)])[
        [k, min(k + 1, values.size - 1)]
    ]
    return float(low + fraction * (high - low))


def eigenvalue_ratios(
    recipe: StudyRecipe, training: Training, cuts: ComplexArray | None = None
) -> FloatArray:
    """Return the largest six eigenvalues of Â over the first (Sec. IV-A).

    NaN in directions that no example reaches. ``cuts`` (n_samples, n_features) are whitened target
    cuts, those of the training without any.
    """
    examples = training.white if cuts is None else cuts
    detector = DeflectionDetector(ddof=recipe.detector.ddof).fit(examples)
    sigma = detector.eigenvalues_.copy()
    reached = sigma.size - int(detector.n_unseen_)
    sigma[reached:] = np.nan
    return np.asarray(sigma[:6] / sigma[0])


def eigenvectors(recipe: StudyRecipe, training: Training) -> ComplexArray:
    """Return the first six eigenvectors of Â as rows of norm one, whitening undone.

    Cosgrove et al. 2004, Fig. 6.
    """
    vectors = DeflectionDetector(6, recipe.detector.ddof).fit(training.white).forms_[0].vectors
    rows = np.linalg.solve(training.whitener.matrix_, vectors.T).T
    return np.asarray(rows / np.linalg.norm(rows, axis=1, keepdims=True))
