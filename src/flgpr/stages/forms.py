"""Maps by linear-quadratic forms: the detectors of Cosgrove et al. 2004 at every pixel."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Annotated, Any, ClassVar, NamedTuple, Self

import numpy as np
import pandas as pd
import xarray as xr
from pydantic import Field, model_validator

from flgpr.clutter import ClutterWhitener
from flgpr.detect import (
    DeflectionDetector,
    LinearQuadraticForm,
    NeymanPearsonDetector,
    PolarimetricWhiteningFilter,
    magnitude_form,
)
from flgpr.detect.scorers.checks import Checked
from flgpr.engine import Accumulator, append_accumulator
from flgpr.features import clean_pixels, clutter_cuts, range_cuts, stack_channels
from flgpr.kernels.moments import moments_estimator
from flgpr.model import ground_points, lane_to_scan
from flgpr.model.bounds import AtLeastOne, NotNegative
from flgpr.stages import MapStage, Positive, Setup, Table
from flgpr.stages.too_few import Change, Tally, TooFewExamplesError, clear_change
from flgpr.types import AnyArray, Arrays, Entries, Float32Array, FloatArray

MOST_FORMS = 64
_FORM = ("strength", "vectors", "linear", "offset")
_REAL = (np.float64, np.float32)
_NUMBERS = (*_REAL, np.complex128, np.complex64)
# Estimators whose covariance has an inverse even if there are fewer samples than values.
_SHRUNK = ("ledoit-wolf", "oas")
_PIXELS = (5, 8)  # down-track and cross-track between the clutter pixels of the whitening filter


class SampleSettings(Table):
    """Range cuts of some polarizations, and how training samples are taken.

    A mine's cut is taken where it is brightest.
    """

    polarizations: tuple[str, ...] = ("HH", "VV")
    length: AtLeastOne = 28  #: of a cut, pixels
    search: NotNegative = 0.5  #: farthest cut from the surveyed mine, m
    clear: Positive = 1.0  #: least distance of clutter from all mines, m
    #: distance of clutter's cuts down-track and cross-track, pixels
    clutter_step: tuple[AtLeastOne, AtLeastOne] = (7, 8)
    moments: str = "ledoit-wolf"  #: estimator of the clutter's mean and covariance
    rank: Annotated[int, Field(ge=0)] = 3  #: number of vectors of the detector

    @model_validator(mode="after")
    def _known(self) -> Self:
        """Refuse an estimator that there is not."""
        moments_estimator(self.moments)
        return self


class CutSettings(SampleSettings):
    """Range cuts of some polarizations, and how training samples and covariances are taken."""

    ddof: Annotated[int, Field(ge=0)] = 1  #: by which a covariance's number of samples is reduced


def learnt_of(forms: Sequence[LinearQuadraticForm], clutter: AnyArray) -> Arrays:
    """Return the arrays of a map by forms.

    Parameters
    ----------
    forms : sequence of LinearQuadraticForm
        The forms.
    clutter : (sample, feature) ndarray
        Samples of clutter.

    Returns
    -------
    dict of str to ndarray
        The forms, and least value and deviation of their largest on the samples.
    """
    largest = np.max([form(clutter) for form in forms], axis=0)
    return learnt_arrays(forms, largest)


def learnt_arrays(forms: Sequence[LinearQuadraticForm], value: FloatArray) -> Arrays:
    """Return the arrays of a map by forms, and least and deviation of its values on clutter."""
    learnt = {}
    for number, form in enumerate(forms):
        for name in _FORM:
            learnt[f"{name}-{number}"] = getattr(form, name)
    learnt["constant"] = np.array([form.constant for form in forms])
    return learnt | {"clutter": np.array([value.min(), value.std()])}


class TrainingSamples(NamedTuple):
    """Training samples."""

    target: AnyArray  #: (sample, feature) cuts of targets
    clutter: AnyArray  #: (sample, feature) cuts of clutter
    pixel: AnyArray  #: (sample, polarization) pixels of clutter


def target_cuts(band: xr.DataArray, mines: FloatArray, settings: SampleSettings) -> AnyArray:
    """Take the range cuts at mines whose whole cut lies in the image.

    Parameters
    ----------
    band : (polarization, y, x) DataArray of complex
        One sub-band of a cleaned scan image.
    mines : (mine, 2) ndarray
        x and y in the scan frame, m.
    settings : SampleSettings
        Length, polarizations and search.

    Returns
    -------
    (sample, feature) ndarray
        The cuts; one that is not finite throughout is left out.
    """
    shape = settings.length, 1
    cuts = range_cuts(band, mines, shape, settings.polarizations, settings.search)
    return cuts[np.isfinite(cuts).all(axis=1)]


def samples_at(band: xr.DataArray, mines: FloatArray, settings: CutSettings) -> TrainingSamples:
    """Take range cuts at mines, and cuts and pixels of the clutter away from them.

    They are of the whole image; the map by intervals of range, "principal-components", takes its
    own from each interval.

    Parameters
    ----------
    band : (polarization, y, x) DataArray of complex
        One sub-band of a cleaned scan image.
    mines : (mine, 2) ndarray
        x and y in the scan frame, m.
    settings : CutSettings
        How samples are taken.

    Returns
    -------
    TrainingSamples
        The samples.
    """
    cut = settings.length, 1
    stack, _ = stack_channels(band, settings.polarizations)
    clean = clean_pixels(band["x"].values, band["y"].values, mines, settings.clear)
    target = target_cuts(band, mines, settings)
    clutter = clutter_cuts(stack, clean, cut, settings.clutter_step)
    pixel = clutter_cuts(stack, clean, (1, 1), _PIXELS)
    return TrainingSamples(target, clutter, pixel)


class FormMap(MapStage):
    """A map by linear-quadratic forms on chips.

    It counts from the least value on clutter, in standard deviations of the values there. So it is
    a magnitude that can be drawn in dB, and means over scans are those of the log-likelihoods.
    """

    learns = True
    not_live_because = "its self-signature is that of the whole run"
    Settings: ClassVar[type[Table]] = CutSettings

    @classmethod
    def check_learnt(cls, settings: Any, setup: Setup, learnt: Checked) -> None:  # noqa: ARG003
        """Check the forms, of as many features as a chip has values, and the scale of clutter."""
        features = cls._features(settings)
        count = len(learnt.array("constant", (cls._form_count(settings),)))
        if not 1 <= count <= MOST_FORMS:
            raise ValueError(f"array 'constant' must be of 1 to {MOST_FORMS} forms, got {count}")
        for number in range(count):
            strength = f"strength-{number}"
            rank = len(learnt.array(strength, (None,), *_REAL))
            if rank > features:
                raise ValueError(f"array {strength!r} must have at most {features}, got {rank}")
            learnt.array(f"vectors-{number}", (rank, features), *_NUMBERS)
            learnt.array(f"linear-{number}", (features,), *_NUMBERS)
            learnt.array(f"offset-{number}", (rank,), *_NUMBERS)
        learnt.array("clutter", (2,))

    @classmethod
    def _features(cls, settings: Any) -> int:
        """Return the number of values of a chip."""
        return len(settings.polarizations) * int(settings.length)

    @classmethod
    def _form_count(cls, settings: Any) -> int | None:  # noqa: ARG003
        """Return the number of forms, or None where it follows from training."""
        return None

    def map(self, image: xr.DataArray) -> Float32Array:
        """Return the detector's value about every pixel (y, x).

        It is the "likelihood map" of Cosgrove et al. 2004, Sec. IV-B.
        """
        stack, _ = stack_channels(image.isel(subband=0, drop=True), self.settings.polarizations)
        maps = [form.likelihood(stack, self._chip) for form in self.forms]
        least, deviation = self.learnt["clutter"]
        return np.asarray((np.max(maps, axis=0) - least) / deviation, dtype=np.float32)

    @property
    def _chip(self) -> tuple[int, int]:
        """Size (y, x) of a chip, pixels."""
        return self.settings.length, 1

    @property
    def forms(self) -> list[LinearQuadraticForm]:
        """The forms that were learnt."""
        forms = []
        for number, constant in enumerate(self.learnt["constant"]):
            arrays = {name: self.learnt[f"{name}-{number}"] for name in _FORM}
            forms.append(LinearQuadraticForm(**arrays, constant=float(constant)))
        return forms

    def examples(self, truth: pd.DataFrame, image: Callable[[int], xr.DataArray]) -> Accumulator:
        """Return what gathers range cuts at the mines, and cuts and pixels of clutter."""
        surveyed = ground_points(truth)
        pieces: list[Arrays] = []

        def add(index: int) -> None:
            mines = lane_to_scan(surveyed, self.setup.pose(index))[:, :2]
            band = image(index).isel(subband=0, drop=True)
            pieces.append(samples_at(band, mines, self.settings)._asdict())

        return append_accumulator(pieces, add)

    @classmethod
    def fit(cls, settings: Any, examples: list[Any]) -> tuple[Arrays, Entries]:
        """Train the detector on the mines of all training lanes, whitened by their clutter."""
        samples = TrainingSamples(
            target=np.concatenate([lane["target"] for lane in examples]),
            clutter=np.concatenate([lane["clutter"] for lane in examples]),
            pixel=np.concatenate([lane["pixel"] for lane in examples]),
        )
        forms = cls._checked(settings, samples)
        reads_pixels = forms[0].linear.size == len(settings.polarizations)
        clutter = samples.pixel if reads_pixels else samples.clutter
        notes = {"looks_at_mines": len(samples.target), "clutter_samples": len(samples.clutter)}
        return learnt_of(forms, clutter), notes

    @classmethod
    def _checked(cls, settings: Any, samples: TrainingSamples) -> list[LinearQuadraticForm]:
        """Return the forms, or refuse too few looks at targets or samples of clutter."""
        looks, cuts, pixels = map(len, samples)
        counts = [
            Tally(looks, "looks at targets whose whole cut lies in the image"),
            Tally(cuts, "cuts of clutter"),
            Tally(pixels, "pixels of clutter"),
        ]
        if looks < 2:
            shorter = Change("length", max(settings.length // 2, 1), settings.length)
            raise TooFewExamplesError(f"2 looks at targets or more, got {looks}", counts, [shorter])
        nearer = clear_change(settings)
        if min(cuts, pixels) < 2:
            needed = f"2 cuts and 2 pixels of clutter or more, got {cuts} and {pixels}"
            raise TooFewExamplesError(needed, counts, [nearer])
        try:
            return cls.trained(settings, samples)
        except ValueError as error:
            shrunk = Change("moments", _SHRUNK[0], settings.moments)
            changes = [nearer if settings.moments in _SHRUNK else shrunk]
            if looks <= settings.ddof:
                changes = [Change("ddof", min(looks - 1, 1), settings.ddof)]
            raise TooFewExamplesError(
                f"samples that moments can be taken of: {error}", counts, changes
            ) from None

    @classmethod
    def trained(cls, settings: Any, samples: TrainingSamples) -> list[LinearQuadraticForm]:
        """Return the forms of training samples."""
        raise NotImplementedError


class DeflectionMap(FormMap):
    """The deflection-optimal linear-quadratic detector (Cosgrove et al. 2004, Eq. 12)."""

    @classmethod
    def _detector(cls, settings: Any) -> DeflectionDetector | NeymanPearsonDetector:
        return DeflectionDetector(settings.rank, settings.ddof)

    @classmethod
    def trained(cls, settings: Any, samples: TrainingSamples) -> list[LinearQuadraticForm]:
        """Return the forms of the detector that is trained on whitened cuts."""
        whitener = ClutterWhitener(settings.moments).fit(samples.clutter)
        trained = cls._detector(settings).fit(whitener.transform(samples.target))
        return [form.after(whitener.mean_, whitener.matrix_) for form in trained.forms_]


class NeymanPearsonMap(DeflectionMap):
    """The Neyman-Pearson detector of Gaussian signals (Cosgrove et al. 2004, Sec. II)."""

    @classmethod
    def _detector(cls, settings: Any) -> NeymanPearsonDetector:
        return NeymanPearsonDetector(settings.rank)


class WhiteningMap(FormMap):
    """The polarimetric whitening filter (Novak et al. 1993), trained on clutter alone."""

    @classmethod
    def _features(cls, settings: Any) -> int:
        return len(settings.polarizations)

    @property
    def _chip(self) -> tuple[int, int]:
        """Size (y, x) of a chip: one pixel."""
        return 1, 1

    @classmethod
    def trained(cls, settings: Any, samples: TrainingSamples) -> list[LinearQuadraticForm]:  # noqa: ARG003
        """Return the form of the pixels' covariance."""
        return list(PolarimetricWhiteningFilter().fit(samples.pixel.astype(np.complex128)).forms_)


class MagnitudeMap(WhiteningMap):
    """The power of the first polarization, as plain HH in Cosgrove et al. 2004."""

    @classmethod
    def trained(cls, settings: Any, samples: TrainingSamples) -> list[LinearQuadraticForm]:  # noqa: ARG003
        """Return the form of the power: only the scale of clutter is learnt."""
        return [magnitude_form(len(settings.polarizations), 0)]
