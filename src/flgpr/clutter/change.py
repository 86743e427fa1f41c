"""What an image has that earlier images of the same ground do not predict.

Two drives over one road differ by a few decimetres in where a scan is taken, by the errors of both
tracks, by gains, and by what has changed on the ground. The echo of unchanged ground in one image
is then nearly that in another, moved by a part of a resolution cell and times a factor, both of
which change slowly along the road. So within each stretch a few copies of the earlier images, each
moved by a pixel or so, predict it by least squares (the linear prediction of Wiener, "Extrapolation,
Interpolation, and Smoothing of Stationary Time Series", 1949): amplitude, phase and place are
matched at once. Where the phase does not hold from drive to drive the prediction is small, and the
image stays as it is.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
import scipy.fft

from flgpr.types import ComplexArray, Float32Array

LOADING = 1e-3
"""What is added to the diagonal of the normal equations, over their mean diagonal."""
LOADING_MOVED = 3e-2
"""The same for copies that are moved by a pixel, which only correct what the others predict.

A stretch holds some hundred resolution cells, and three looks of a drive make 27 copies: with much
less loading those of several drives would predict a part of what is new, too.
"""
_THINNED = 2  # of neighbouring pixels, which lie within a resolution cell, one is fitted


def offset_between(
    image: ComplexArray, earlier: ComplexArray, most: tuple[int, int]
) -> tuple[int, int]:
    """Return how many pixels an earlier image must be moved by to lie on an image.

    It is where the magnitude of their cross-correlation, summed over channels, is greatest.

    Parameters
    ----------
    image, earlier : (channel, y, x) ndarray of complex
        Two images on the same pixels.
    most : (int, int)
        Greatest offset that is looked for along y and along x, pixels.
    """
    ny, nx = image.shape[1:]
    shape = (scipy.fft.next_fast_len(ny + most[0]), scipy.fft.next_fast_len(nx + most[1]))
    product = scipy.fft.fft2(image, shape) * scipy.fft.fft2(earlier, shape).conj()
    correlation = np.abs(scipy.fft.ifft2(product.sum(axis=0)))
    rows, columns = (np.arange(-reach, reach + 1) for reach in most)
    near = correlation[np.ix_(rows, columns)]
    row, column = np.unravel_index(np.argmax(near), near.shape)
    return int(rows[row]), int(columns[column])


def moved(image: ComplexArray, rows: int, columns: int) -> ComplexArray:
    """Return an image (..., y, x) moved by pixels; what comes in from beyond its border is zero."""
    out = np.zeros_like(image)
    ny, nx = image.shape[-2:]
    to_rows = slice(max(rows, 0), ny + min(rows, 0))
    to_columns = slice(max(columns, 0), nx + min(columns, 0))
    from_rows = slice(max(-rows, 0), ny + min(-rows, 0))
    from_columns = slice(max(-columns, 0), nx + min(-columns, 0))
    out[..., to_rows, to_columns] = image[..., from_rows, from_columns]
    return out


def predicted(
    image: ComplexArray,
    earlier: Sequence[ComplexArray],
    stretch: tuple[int, int],
    reach: int = 1,
    rows: int | None = None,
) -> ComplexArray:
    """Predict an image from earlier ones, stretch by stretch.

    Stretches overlap by half, and their predictions are blended.

    Parameters
    ----------
    image : (y, x) ndarray of complex
        The image.
    earlier : sequence of (y, x) ndarray of complex
        Earlier images on the same pixels, moved to lie on it.
    stretch : (int, int)
        Size of a stretch along y and along x, pixels.
    reach : int
        Copies are moved by up to so many pixels along each axis.
    rows : int, optional
        The first rows that are wanted; by default all.

    Returns
    -------
    (y, x) ndarray of complex64
        The prediction, of the rows that are wanted.

    Raises
    ------
    ValueError
        If a stretch has fewer fitted pixels than twice the copies.
    """
    steps = range(-reach, reach + 1)
    shifts = [(row, column) for row in steps for column in steps]
    copies = np.stack([moved(one, *shift) for one in earlier for shift in shifts])
    loading = np.tile([LOADING_MOVED if any(shift) else LOADING for shift in shifts], len(earlier))
    fitted = -(-stretch[0] // _THINNED) * -(-stretch[1] // _THINNED)
    if fitted < 2 * len(copies):
        raise ValueError(
            f"stretch must hold {2 * len(copies)} fitted pixels for {len(copies)} copies of earlier "
            f"images, got {fitted}"
        )
    total = np.zeros(image.shape, np.complex64)
    weights = np.zeros(image.shape, np.float32)
    for part in _stretches(image.shape[0], stretch[0]):
        if rows is not None and part.start >= rows:
            break
        for columns in _stretches(image.shape[1], stretch[1]):
            of_copies = copies[:, part, columns]
            basis = of_copies[:, ::_THINNED, ::_THINNED].reshape(len(copies), -1)
            wanted = image[part, columns][::_THINNED, ::_THINNED].ravel()
            normal = basis.conj() @ basis.T
            diagonal = np.trace(normal).real / len(copies)
            if diagonal > 0:
                normal += np.diag(loading * diagonal).astype(normal.dtype)
                factors = np.linalg.solve(normal, basis.conj() @ wanted)
                blend = np.outer(*(_blend(axis.stop - axis.start) for axis in (part, columns)))
                total[part, columns] += np.tensordot(factors, of_copies, 1) * blend
                weights[part, columns] += blend
    return np.asarray(total / np.where(weights > 0, weights, 1), np.complex64)[:rows]


def _stretches(pixels: int, size: int) -> Iterator[slice]:
    """Yield the pixels of stretches that overlap by half and cover an axis."""
    size = min(size, pixels)
    starts = np.linspace(0, pixels - size, max(1, -(-2 * (pixels - size) // size) + 1))
    for start in np.unique(np.rint(starts).astype(int)):
        yield slice(int(start), int(start) + size)


def _blend(pixels: int) -> Float32Array:
    """Return weights that fall off towards both ends and are nowhere zero."""
    return np.asarray(np.hanning(pixels + 2)[1:-1], np.float32)
