"""Coherent sums over frames (Fuse et al. 2018, Eq. 4): the operator, the pose accuracy they need, and its check."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.ndimage import maximum_filter
from scipy.optimize import brentq

from flgpr.clutter.iteration import Amplitude, Iterated, OperatorOn, averaged, iterate_suppression
from flgpr.clutter.suppression import Operator
from flgpr.model import SPEED_OF_LIGHT

ComplexArray = NDArray[np.complex64]
FloatArray = NDArray[np.float64]


class FrameStack:
    """Operators of several frames as one: its adjoint is the coherent sum over frames (Fuse et al. 2018, Eq. 4).

    The image is one reflectivity that all frames share: to iterate on it is a reading of the paper, which sums the
    frames' images and says of the suppression "the same mask in each frame" (Sec. 2.3), see :func:`iterate_frames`.
    ``operators`` are A of every frame, on the same pixels.
    """

    def __init__(self, operators: Sequence[Operator]) -> None:
        if not operators:
            raise ValueError("operators must hold at least one frame, got none")
        self.operators = tuple(operators)

    def adjoint(self, data: ArrayLike) -> ComplexArray:
        """Sum the images of all frames: (frame, polarization, pair, frequency) to (polarization, subband, ...)."""
        frames = np.asarray(data)
        if len(frames) != len(self.operators):
            raise ValueError(f"data must hold {len(self.operators)} frames, got {len(frames)}")
        total = self.operators[0].adjoint(frames[0])
        for operator, one in zip(self.operators[1:], frames[1:], strict=True):
            total = total + operator.adjoint(one)
        return total

    def forward(self, image: ArrayLike) -> ComplexArray:
        """Model the data of all frames: (polarization, subband, ...) to (frame, polarization, pair, frequency)."""
        return np.stack([operator.forward(image) for operator in self.operators])


def iterate_frames(
    data: ArrayLike,
    operator_on: Sequence[OperatorOn],
    pixels: ArrayLike,
    mask: ArrayLike,
    region: ArrayLike,
    iterations: int = 7,
    amplitude: Amplitude = "region",
) -> list[Iterated]:
    """Suppress frame by frame under one mask, with a reflectivity of its own in every frame.

    This is "using the same mask in each frame" (Fuse et al. 2018, Sec. 2.3) as it is written. It asks for no coherence
    from frame to frame: what stands above the ground, turns its side to the radar or is seen from a pose that is a
    little wrong still fits. Data have a leading axis of frames, each with its ``operator_on``; the rest is as in
    :func:`iterate_suppression`.
    """
    frames = zip(np.asarray(data), operator_on, strict=True)
    return [
        iterate_suppression(one, make, pixels, mask, region, iterations, amplitude)
        for one, make in frames
    ]


def averaged_frames(
    courses: Sequence[Iterated], combination: int, fall_back: bool = True
) -> ComplexArray:
    """Average the iterations of a combination in every frame, see :func:`averaged`; (frame, ...) ndarray."""
    return np.stack([averaged(course, combination, fall_back) for course in courses])


def coherent_loss_db(error: ArrayLike, frequency: ArrayLike) -> FloatArray:
    """Loss, dB, of a coherent sum over many frames whose ranges are wrong (deviation σ, m), for tones in Hz.

    An error δ along the line of sight turns a tone by 4πfδ/c; with independent normal errors of
    deviation σ the mean field over the frames falls by ``exp(-(4πfσ/c)²/2)``, averaged over the
    tones. An error of the heading turns the array about its middle: it shifts the image across and
    hardly changes its phase, so it does not enter.

    Examples
    --------
    Ranges wrong by 1 cm rms from frame to frame cost a band below 3 GHz a few dB, and wipe out the X band.

    >>> import numpy as np
    >>> from flgpr.clutter import coherent_loss_db
    >>> [round(float(coherent_loss_db(0.01, np.linspace(*band))), 1) for band in ((0.75e9, 3.2e9), (8.4e9, 10.4e9))]
    [3.1, 64.0]
    """
    turn = (
        4
        * np.pi
        / SPEED_OF_LIGHT
        * np.multiply.outer(np.asarray(error, float), np.asarray(frequency, float))
    )
    return np.asarray(0.0 - 20 * np.log10(np.exp(-(turn**2) / 2).mean(axis=-1)))


def accuracy_needed(frequency: ArrayLike, loss_db: float = 1.0) -> float:
    """Compute the accuracy of the range that a coherent sum over frames needs (Fuse et al. 2018, Eq. 4).

    It is the standard deviation along the line of sight from frame to frame, m, for tones in Hz and
    the loss, dB, that is put up with.

    Examples
    --------
    >>> import numpy as np
    >>> from flgpr.clutter import accuracy_needed
    >>> [round(1e3 * accuracy_needed(np.linspace(*band)), 1) for band in ((0.75e9, 3.2e9), (8.4e9, 10.4e9))]  # mm
    [5.5, 1.2]
    """
    if not loss_db > 0:
        raise ValueError(f"loss_db must be positive, got {loss_db}")
    tones = np.asarray(frequency, dtype=np.float64)
    turn = 4 * np.pi * tones.min() / SPEED_OF_LIGHT
    # The lowest tone alone would stand an error of `most`; all tones together stand less.
    most = np.sqrt(loss_db * np.log(10) / 10) / turn
    return float(
        brentq(lambda sigma: float(coherent_loss_db(sigma, tones)) - loss_db, 0.0, 1.001 * most)
    )


@dataclass(frozen=True)
class Coherence:
    """How well frames agree at strong pixels."""

    # : magnitude of the sum under the sum of the frames' own peaks, dB, by pixel, strongest first
    loss_db: FloatArray
    at: NDArray[np.int64]  #: (pixel, 2): row and column of each


def measured_coherence(
    images: ArrayLike, reach: int = 2, apart: int = 10, most: int = 20
) -> Coherence:
    """Measure the loss of the coherent sum at the strongest pixels of images (frame, y, x), at least two.

    A frame's own peak may lie ``reach`` pixels from one of the sum; at ``most`` so many peaks, that many pixels
    ``apart``, are taken. Pose errors are one cause; an object above the ground that is focused on it, or one that
    glints, is another, so this is an upper bound of what poses cost.
    """
    frames = np.asarray(images)
    if frames.ndim != 3 or len(frames) < 2:
        raise ValueError(
            f"images must be (frame, y, x) with at least two frames, got {frames.shape}"
        )
    total = np.abs(frames.sum(axis=0))
    single = np.sum([maximum_filter(np.abs(one), size=2 * reach + 1) for one in frames], axis=0)
    peak = (total == maximum_filter(total, size=2 * apart + 1)) & (total > 0)
    rows, columns = np.nonzero(peak)
    order = np.argsort(-total[rows, columns], kind="stable")[:most]
    at = np.column_stack([rows[order], columns[order]]).astype(np.int64)
    loss = -20 * np.log10(total[at[:, 0], at[:, 1]] / single[at[:, 0], at[:, 1]])
    return Coherence(loss, at)
