"""Coherent sums over frames (Fuse et al. 2018, Eq. 4): operator, pose accuracy, and check."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.optimize import brentq

from flgpr.clutter.iteration import Amplitude, Iterated, OperatorOn, averaged, iterate_suppression
from flgpr.clutter.suppression import Operator
from flgpr.model import SPEED_OF_LIGHT
from flgpr.types import ArrayLike, ComplexArray, FloatArray, floats


class FrameStack:
    """Combine the operators of several frames into one.

    Its adjoint is the coherent sum over frames (Fuse et al. 2018, Eq. 4).
    The image is one reflectivity that all frames share. To iterate on it is a reading of the paper,
    which sums the frames' images and says of the suppression "the same mask in each frame"
    (Sec. 2.3), see :func:`iterate_frames`.

    Parameters
    ----------
    operators : sequence of imaging operators
        A of every frame, on the same pixels.
    """

    def __init__(self, operators: Sequence[Operator]) -> None:
        if not operators:
            raise ValueError("operators must hold at least one frame, got none")
        self.operators = tuple(operators)

    def adjoint(self, data: ArrayLike) -> ComplexArray:
        """Return the sum of the images of all frames.

        Data (frame, polarization, pair, frequency) become an image (polarization, subband, ...).
        """
        frames = np.asarray(data)
        if len(frames) != len(self.operators):
            raise ValueError(f"data must hold {len(self.operators)} frames, got {len(frames)}")
        total = self.operators[0].adjoint(frames[0])
        for operator, frame in zip(self.operators[1:], frames[1:], strict=True):
            total = total + operator.adjoint(frame)
        return total

    def forward(self, image: ArrayLike) -> ComplexArray:
        """Return the modelled data of all frames.

        An image (polarization, subband, ...) becomes data (frame, polarization, pair, frequency).
        """
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
    """Suppress frame by frame under one mask, with a reflectivity per frame.

    This is "using the same mask in each frame" (Fuse et al. 2018, Sec. 2.3) as it is written. It
    needs no coherence from frame to frame: what stands above the ground, turns its side to the
    radar or is seen from a slightly wrong pose still fits.

    Parameters
    ----------
    data : (frame, ..., polarization, pair, frequency) array_like of complex
        Received field of every frame.
    operator_on : sequence of callable
        Makes A on any pixels, for every frame.
    pixels, mask, region, iterations, amplitude
        As for :func:`iterate_suppression`.

    Returns
    -------
    list of Iterated
        The iterated suppression of every frame.
    """
    suppressed = []
    for frame, frame_operator_on in zip(np.asarray(data), operator_on, strict=True):
        suppressed.append(
            iterate_suppression(
                frame, frame_operator_on, pixels, mask, region, iterations, amplitude
            )
        )
    return suppressed


def averaged_frames(
    courses: Sequence[Iterated], combination: int, fall_back: bool = True
) -> ComplexArray:
    """Return the averaged iterations of every frame, (frame, ...) ndarray; see :func:`averaged`."""
    return np.stack([averaged(iterated, combination, fall_back) for iterated in courses])


def coherent_loss_db(error: ArrayLike, frequency: ArrayLike) -> FloatArray:
    """Compute the loss of a coherent sum over many frames whose ranges are wrong.

    An error δ along the line of sight turns a tone by 4πfδ/c; with independent normal errors of
    deviation σ the mean field over the frames falls by ``exp(-(4πfσ/c)²/2)``, averaged over the
    tones. An error of the heading turns the array about its middle: it shifts the image across and
    hardly changes its phase, so it does not enter.

    Parameters
    ----------
    error : (...,) array_like
        Standard deviation σ of the range from frame to frame, m.
    frequency : (frequency,) array_like
        Tones, Hz.

    Returns
    -------
    (...,) ndarray
        Loss, dB.

    Examples
    --------
    Ranges wrong by 1 cm rms from frame to frame cost a band below 3 GHz a few dB, and wipe out the
    X band.

    >>> import numpy as np
    >>> from flgpr.clutter import coherent_loss_db
    >>> round(float(coherent_loss_db(0.01, np.linspace(0.75e9, 3.2e9))), 1)
    3.1
    >>> round(float(coherent_loss_db(0.01, np.linspace(8.4e9, 10.4e9))), 1)
    64.0
    """
    error_by_tone = np.multiply.outer(np.asarray(error, float), np.asarray(frequency, float))
    turn = 4 * np.pi / SPEED_OF_LIGHT * error_by_tone
    return np.asarray(0.0 - 20 * np.log10(np.exp(-(turn**2) / 2).mean(axis=-1)))


def accuracy_needed(frequency: ArrayLike, loss_db: float = 1.0) -> float:
    """Compute the range accuracy that a coherent sum over frames needs (Fuse et al. 2018, Eq. 4).

    Parameters
    ----------
    frequency : (frequency,) array_like
        Tones, Hz.
    loss_db : float
        Acceptable loss, dB.

    Returns
    -------
    float
        Standard deviation along the line of sight from frame to frame, m.

    Examples
    --------
    >>> import numpy as np
    >>> from flgpr.clutter import accuracy_needed
    >>> round(1e3 * accuracy_needed(np.linspace(0.75e9, 3.2e9)), 1)  # mm
    5.5
    >>> round(1e3 * accuracy_needed(np.linspace(8.4e9, 10.4e9)), 1)
    1.2
    """
    if not loss_db > 0:
        raise ValueError(f"loss_db must be positive, got {loss_db}")
    tones = floats(frequency)
    turn = 4 * np.pi * tones.min() / SPEED_OF_LIGHT
    # All tones together allow less than the lowest one alone.
    upper_bound = np.sqrt(loss_db * np.log(10) / 10) / turn

    def excess_loss(sigma: float) -> float:
        return float(coherent_loss_db(sigma, tones)) - loss_db

    return float(brentq(excess_loss, 0.0, 1.001 * upper_bound))
