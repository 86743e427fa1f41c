"""The suppression of Fuse et al. 2018 by every variant that is compared, aperture by aperture."""

from __future__ import annotations

import time
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from flgpr.clutter import (
    TABLE_II,
    Iterated,
    averaged_frames,
    equal_cost,
    fallen_back,
    suppress_by_model,
)
from flgpr.stages.masks import Aperture, MaskedSuppression
from flgpr.types import Arrays, BoolArray, ComplexArray, Entries, FloatArray
from flgpr_papers.fuse2018.lanes import Frames, trained
from flgpr_papers.kit.settings import packaged_text

_DECLARED: dict[str, Entries] = tomllib.loads(packaged_text("fuse2018", "variants"))
VARIANTS: dict[str, str] = {name: one["title"] for name, one in _DECLARED.items()}
"""Variants of the suppression that are compared, and how they are called in full."""


@dataclass(frozen=True)
class Calibration:
    """What the calibration lane teaches."""

    #: thresholds of the masks as the stage takes them, and the looks at targets that they rest on
    learnt: Arrays
    #: (row,) median magnitude of VV between the roadsides at every distance ahead, in which units
    #: alarms are measured
    background: FloatArray


@dataclass(frozen=True)
class Cleaned:
    """An aperture with its masks and what each variant made of it."""

    index: int  #: the latest frame
    forms: dict[str, MaskedSuppression]  #: the stage by variant, of the variants that it knows
    aperture: Aperture
    masks: dict[str, BoolArray]  #: mixed masks: "pixel", "region", "L" and "calibrated"
    courses: list[Iterated]  #: of the iteration in each frame under one mask
    data: dict[str, ComplexArray]  #: (frame, 1, pair, frequency) by variant
    images: dict[str, ComplexArray]  #: by variant, in the scan frame of the latest frame
    rows: list[Entries]  #: one per variant, for ``LaneRecords.courses``

    @property
    def stage(self) -> MaskedSuppression:
        """The stage as the paper has it."""
        return self.forms["iteration"]

    @property
    def pose(self) -> FloatArray:
        """Pose of the latest frame."""
        return self.stage.setup.pose(self.index)


def stage_forms(frames: Frames, calibration: Calibration) -> dict[str, MaskedSuppression]:
    """Return the trained stage of the detection chain with the settings of each variant.

    Variants that the stage does not know are left out.
    """
    return {
        name: trained(frames.stage, calibration.learnt, **variant["settings"])
        for name, variant in _DECLARED.items()
        if "settings" in variant
    }


def clean(forms: dict[str, MaskedSuppression], index: int, variants: Sequence[str]) -> Cleaned:
    """Form the masks of an aperture and suppress what lies under them, by every variant.

    Parameters
    ----------
    forms : dict of MaskedSuppression
        The trained stage by variant, see :func:`stage_forms`.
    index : int
        Latest frame of the aperture.
    variants : sequence of str
        Names of the variants.
    """
    stage = forms["iteration"]
    aperture = stage.aperture(index)
    stack = aperture.stack_on(stage.points)
    masks = {
        "pixel": stage.mask(aperture),
        "region": forms["regions"].mask(aperture),
        "L": stage.mask(replace(aperture, second=None)),
        "calibrated": forms["calibrated roadside"].mask(aperture),
    }
    before = time.process_time()
    main_courses = stage.courses(aperture, masks["pixel"])
    # The courses of "iteration" serve other variants, too: their time is its own.
    main_seconds = time.process_time() - before
    data = {}
    images = {}
    rows = []
    for variant in variants:
        before = time.process_time()
        cleaned, courses = _suppressed(variant, forms, aperture, masks, main_courses)
        seconds = time.process_time() - before
        if variant == "iteration":
            seconds += main_seconds
        data[variant] = cleaned
        images[variant] = stack.adjoint(cleaned)[0, 0]
        original = aperture.data[:, stage.setup.imaged]
        falls_back = variant != "as printed" and forms.get(variant, stage).settings.fall_back
        combination = stage.settings.combination
        rows.append(
            {
                "frame": index,
                "variant": variant,
                "rises": sum(course.rises for course in courses),
                "rise": max((course.rise for course in courses), default=0.0),
                "diverged": any(course.diverged for course in courses),
                "fallen": falls_back and any(fallen_back(one, combination) for one in courses),
                "residual": float(np.linalg.norm(cleaned) / np.linalg.norm(original)),
                "masked": float(masks[_DECLARED[variant].get("mask", "pixel")].mean()),
                "cpu": seconds,
            }
        )
    return Cleaned(index, forms, aperture, masks, main_courses, data, images, rows)


def _suppressed(
    variant: str,
    forms: dict[str, MaskedSuppression],
    aperture: Aperture,
    masks: dict[str, BoolArray],
    main_courses: list[Iterated],
) -> tuple[ComplexArray, list[Iterated]]:
    """Clean an aperture by a variant; returns the data and the courses of its iterations.

    ``main_courses`` are those of "iteration".
    """
    stage = forms.get(variant, forms["iteration"])
    data = aperture.data[:, stage.setup.imaged]
    mask = masks[_DECLARED[variant].get("mask", "pixel")]
    if variant == "original":
        return data, []
    if variant == "as printed":
        combination = stage.settings.combination
        return averaged_frames(main_courses, combination, fall_back=False), main_courses
    if variant in ("least squares", "least squares spared"):
        return stage.least_squares(aperture, mask), []
    if variant == "least squares per frame":
        if not mask.any():
            return data, []
        points = stage.points[mask]
        iterations = equal_cost(stage.settings.iterations, mask, stage.region)
        cleaned = [
            suppress_by_model(frame, operator_on(points), iterations).data
            for frame, operator_on in zip(data, aperture.operators, strict=True)
        ]
        return np.stack(cleaned), []
    courses = main_courses
    if variant != "iteration":
        courses = stage.courses(aperture, mask)
    return stage.averaged(courses), courses


def suppressed_alone(cleaned: Cleaned, data: ComplexArray) -> ComplexArray:
    """Suppress data by the mask and the amplitudes B of an aperture's iteration, held fixed.

    This is a linear operation.

    Parameters
    ----------
    cleaned : Cleaned
        The aperture.
    data : (frame, 1, pair, frequency) ndarray
        Other data of the same frames.
    """
    stage = cleaned.stage
    mask = cleaned.masks["pixel"]
    regions = np.unique(stage.region[mask])
    combination = stage.settings.combination
    suppressed = []
    for frame, operator_on, course in zip(
        data, cleaned.aperture.operators, cleaned.courses, strict=True
    ):
        operators = {
            int(region): operator_on(stage.points[mask & (stage.region == region)])
            for region in regions
        }
        iterates = [frame]
        for B in course.amplitude:
            rest = iterates[-1]
            for region, operator in operators.items():
                x_hat = operator.adjoint(iterates[-1])
                rest = rest - np.float32(B[region, 0]) * operator.forward(x_hat)  # Eq. 5 and 6
            iterates.append(rest)
        best = fallen_back(course, combination).get(0)
        iterations = TABLE_II[combination] if best is None else (best,)
        suppressed.append(np.mean([iterates[number] for number in iterations], axis=0))
    return np.stack(suppressed).astype(np.complex64)
