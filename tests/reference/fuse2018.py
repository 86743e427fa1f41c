"""Fuse et al. 2018, Eq. 1, 2 and 5, term by term in double precision."""

import numpy as np

C = 299792458.0


def equation_2_path(tx, rx, pixels):
    return np.linalg.norm(pixels - tx, axis=-1) + np.linalg.norm(pixels - rx, axis=-1)


def equation_1_image(b, frequency, tx, rx, pixels, weight=None):
    """Image (pixel,) of data (pair, frequency)."""
    weight = np.ones(len(frequency)) if weight is None else weight
    x = np.zeros(len(pixels), complex)
    for n in range(len(tx)):
        path = equation_2_path(tx[n], rx[n], pixels)
        for k, f in enumerate(frequency):
            x += weight[k] * b[n, k] * np.exp(2j * np.pi * f * path / C)
    return x


def equation_5_data(x, frequency, tx, rx, pixels, weight=None):
    """Data (pair, frequency) of an image (pixel,)."""
    weight = np.ones(len(frequency)) if weight is None else weight
    b = np.zeros((len(tx), len(frequency)), complex)
    for n in range(len(tx)):
        path = equation_2_path(tx[n], rx[n], pixels)
        for k, f in enumerate(frequency):
            b[n, k] = weight[k] * np.sum(x * np.exp(-2j * np.pi * f * path / C))
    return b


def equation_3_matrix(frequency, tx, rx, pixels):
    """A as a matrix (pair * frequency, pixel)."""
    columns = [equation_5_data([1.0], frequency, tx, rx, pixel[None]).ravel() for pixel in pixels]
    return np.array(columns).T


def equations_5_to_8(b, A, mask, region, iterations, whole=False):
    """Data after every iteration; b (sample,), A (sample, pixel), mask and region (pixel,).

    ``whole``: x'_2 of Eq. 8 is that of the masked image of all sub-regions, not of the sub-region's own.
    """
    course = [b]
    for _ in range(iterations):
        x = A.conj().T @ course[-1]
        total = np.zeros_like(b)
        for r in set(region[mask]):
            x_hat = np.where(mask & (region == r), x, 0)
            b_hat = A @ x_hat
            x_2 = A.conj().T @ (A @ np.where(mask, x, 0) if whole else b_hat)
            total = total + max(abs(x_hat)) / max(abs(x_2[region == r])) * b_hat
        course.append(course[-1] - total)
    return course


def extended_mask_as_written(vv, vh, low_vv, low_vh, across):
    """(VV_low ∩ VH_low) ∪ VH_low at the roadside, one threshold each."""
    out = np.zeros(vv.shape, bool)
    for i in np.ndindex(*vv.shape):
        vv_low = abs(vv[i]) > low_vv
        vh_low = abs(vh[i]) > low_vh
        out[i] = ((vv_low and vh_low) or vh_low) and (
            -10 <= across[i] <= -4 or 4 <= across[i] <= 10
        )
    return out


def regions_that_meet(shape, other):
    """Connected regions (eight neighbours) of one mask that share a pixel with another, by flooding."""
    out = np.zeros(shape.shape, bool)
    todo = [i for i in np.ndindex(*shape.shape) if shape[i] and other[i]]
    while todo:
        row, column = todo.pop()
        inside = 0 <= row < shape.shape[0] and 0 <= column < shape.shape[1]
        if not inside or out[row, column] or not shape[row, column]:
            continue
        out[row, column] = True
        todo += [(row + v, column + u) for v in (-1, 0, 1) for u in (-1, 0, 1)]
    return out
