"""Descriptors of square patches of an image: oriented gradients, local binary patterns, windows.

HOG, LBP and dense local descriptors as computer vision has them, on magnitudes about an alarm.
"""

from __future__ import annotations

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from flgpr.types import AnyArray, BoolArray, FloatArray, IntArray, floats

_EPSILON = 1e-5  # of norms, so that a region without a gradient stays zero
_CLIP = 0.2  # largest component of a unit vector before it is scaled again
_NEIGHBOURS = 8  # of a pixel in a local binary pattern, at a distance of one pixel
LBP_CODES = _NEIGHBOURS + 2
"""Rotation-invariant uniform patterns, and one code for all others."""
LOCAL_CELLS = 4
"""Cells of a window of gradients each way (Lowe 2004)."""
LOCAL_BINS = 8
"""Directions of its histograms (Lowe 2004)."""


def normalize_by_border(patches: AnyArray, known: BoolArray) -> FloatArray:
    """Bring patches to zero mean and unit deviation of their borders.

    The border is what lies outside of the central half, both ways: there the ground is, not what
    raised the alarm. So does the program that Camilo, Collins & Malof published with "A Large
    Comparison of Feature-Based Approaches for Buried Target Classification in Forward-Looking
    Ground-Penetrating Radar", IEEE Trans. Geoscience and Remote Sensing 56(1), 2018.

    Parameters
    ----------
    patches : (..., v, u) ndarray
        Magnitudes.
    known : (..., v, u) ndarray of bool
        Which pixels have one; it is broadcast.

    Returns
    -------
    (..., v, u) ndarray
        Pixels without a magnitude are zero, and so are patches whose border has none. A border that
        is flat divides by one.
    """
    v, u = patches.shape[-2:]
    border = np.ones((v, u), dtype=bool)
    border[v // 4 : v - v // 4, u // 4 : u - u // 4] = False
    known_border = np.broadcast_to(known & border, patches.shape)
    count = known_border.sum(axis=(-2, -1), keepdims=True)
    values = floats(np.where(known, patches, 0.0))

    def mean_of_border(of: FloatArray) -> FloatArray:
        """Return the means (..., 1, 1) of the known pixels of the border."""
        total = np.where(known_border, of, 0.0).sum(axis=(-2, -1), keepdims=True)
        return total / np.maximum(count, 1)

    mean = mean_of_border(values)
    deviation = np.sqrt(mean_of_border((values - mean) ** 2))
    deviation = np.where(deviation > 0, deviation, 1.0)
    return np.where(known & (count > 0), (values - mean) / deviation, 0.0)


def oriented_gradients(patches: FloatArray, bins: int, signed: bool) -> FloatArray:
    """Return the magnitude of every pixel's gradient in the bin of its direction.

    Gradients are central differences, zero on the outermost rows and columns.

    Parameters
    ----------
    patches : (..., v, u) ndarray
        Images.
    bins : int
        Number of directions.
    signed : bool
        Whether directions go round a full turn; else opposite ones are the same.

    Returns
    -------
    (..., bin, v, u) ndarray
        Magnitudes; all bins but one are zero.
    """
    along_v = np.zeros_like(patches)
    along_u = np.zeros_like(patches)
    along_v[..., 1:-1, :] = patches[..., 2:, :] - patches[..., :-2, :]
    along_u[..., :, 1:-1] = patches[..., :, 2:] - patches[..., :, :-2]
    turn = 360.0 if signed else 180.0
    direction = np.rad2deg(np.arctan2(along_v, along_u)) % turn
    number = np.minimum((direction * (bins / turn)).astype(np.int64), bins - 1)
    in_bin = number[..., None, :, :] == np.arange(bins)[:, None, None]
    magnitude = np.hypot(along_v, along_u)
    return np.where(in_bin, magnitude[..., None, :, :], 0.0)


def hog(patches: FloatArray, cell: int, block: int = 2, bins: int = 9) -> FloatArray:
    """Return histograms of oriented gradients (Dalal & Triggs, CVPR 2005).

    Directions are unsigned, blocks overlap by all but one cell, and their norm is L2-Hys: scaled to
    one, clipped at 0.2, scaled again. Votes go to one direction and cell, without interpolation.
    Pixels that no cell takes are left over on all sides alike.

    Parameters
    ----------
    patches : (..., v, u) ndarray
        Images.
    cell : int
        Pixels of a cell each way.
    block : int
        Cells of a block each way.
    bins : int
        Number of directions.

    Returns
    -------
    (..., feature) ndarray
        Block after block, cell after cell.

    Raises
    ------
    ValueError
        If a patch has fewer cells than a block.
    """
    v, u = patches.shape[-2:]
    rows = v // cell
    columns = u // cell
    if min(rows, columns) < block:
        raise ValueError(
            f"patches must have at least {block} cells of {cell} pixels each way, got {v} x {u} "
            "pixels"
        )
    first_v = (v - rows * cell) // 2
    first_u = (u - columns * cell) // 2
    votes = oriented_gradients(patches, bins, signed=False)
    votes = votes[..., first_v : first_v + rows * cell, first_u : first_u + columns * cell]
    in_cells = votes.reshape(*votes.shape[:-2], rows, cell, columns, cell)
    cells = np.moveaxis(in_cells.mean(axis=(-3, -1)), -3, -1)  # (..., row, column, bin)

    windows = sliding_window_view(cells, (block, block), axis=(-3, -2))
    blocks = np.moveaxis(windows, -3, -1)  # (..., row, column, row in it, column in it, bin)
    blocks = blocks.reshape(*blocks.shape[:-3], -1)
    blocks = np.minimum(_unit(blocks), _CLIP)
    return _unit(blocks).reshape(*patches.shape[:-2], -1)


def _unit(vectors: FloatArray) -> FloatArray:
    """Scale vectors (..., component) to a norm of one."""
    norm = np.sqrt((vectors**2).sum(axis=-1, keepdims=True) + _EPSILON**2)
    return vectors / norm


def local_binary_patterns(patches: FloatArray) -> IntArray:
    """Return the rotation-invariant uniform local binary pattern of every inner pixel.

    See Ojala, Pietikäinen & Mäenpää, IEEE Trans. Pattern Analysis and Machine Intelligence 24(7),
    2002, Eq. 9, with eight neighbours at a distance of one pixel; those on the diagonals are
    interpolated.

    Parameters
    ----------
    patches : (..., v, u) ndarray
        Images.

    Returns
    -------
    (..., v - 2, u - 2) ndarray
        How many neighbours are as large as the pixel or larger, 0 to 8, where they are in one
        piece; else 9.
    """
    v, u = patches.shape[-2:]
    centre = patches[..., 1:-1, 1:-1]
    offset = np.sqrt(0.5)  # of a neighbour on a diagonal, pixels

    def shifted(down: int, right: int) -> FloatArray:
        """Return the pixel at an offset from every inner pixel."""
        return patches[..., 1 + down : v - 1 + down, 1 + right : u - 1 + right]

    def diagonal(down: int, right: int) -> FloatArray:
        """Return the value one pixel away on a diagonal, bilinear between four pixels."""
        sides = shifted(down, 0) + shifted(0, right)
        without_corner = (1 - offset) ** 2 * centre + offset * (1 - offset) * sides
        return without_corner + offset**2 * shifted(down, right)

    around = ((0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1), (1, 0), (1, 1))
    neighbours = [diagonal(*at) if all(at) else shifted(*at) for at in around]
    bits = np.stack([neighbour >= centre for neighbour in neighbours])
    changes = (bits != np.roll(bits, 1, axis=0)).sum(axis=0)
    return np.where(changes <= 2, bits.sum(axis=0), _NEIGHBOURS + 1)


def lbp_histograms(patches: FloatArray, divisions: int) -> FloatArray:
    """Return how often each local binary pattern is in each part of a patch.

    Parameters
    ----------
    patches : (..., v, u) ndarray
        Images.
    divisions : int
        Parts of a patch each way, as equal as pixels allow (Ahonen, Hadid & Pietikäinen, IEEE
        Trans. Pattern Analysis and Machine Intelligence 28(12), 2006).

    Returns
    -------
    (..., feature) ndarray
        Shares, part after part, of :data:`LBP_CODES` patterns each.
    """
    codes = local_binary_patterns(patches)
    is_code = codes[..., None] == np.arange(LBP_CODES)
    shares = [block.mean(axis=-2) for block in split_grid(floats(is_code), divisions)]
    return np.stack(shares, axis=-2).reshape(*patches.shape[:-2], -1)


def split_grid(values: FloatArray, divisions: int) -> list[FloatArray]:
    """Split values on a grid into parts each way, as equal as can be.

    Parameters
    ----------
    values : (..., row, column, component) ndarray
        Values.
    divisions : int
        Parts each way.

    Returns
    -------
    list of (..., position, component) ndarray
        The parts, row after row.

    Raises
    ------
    ValueError
        If the grid has fewer rows or columns than parts.
    """
    rows, columns = values.shape[-3:-1]
    if min(rows, columns) < divisions:
        raise ValueError(
            f"grid must have {divisions} places or more each way, got {rows} x {columns}"
        )
    return [
        block.reshape(*block.shape[:-3], -1, block.shape[-1])
        for band in np.array_split(values, divisions, axis=-3)
        for block in np.array_split(band, divisions, axis=-2)
    ]


def pixel_windows(patches: FloatArray, size: int, step: int) -> FloatArray:
    """Return the pixels of all windows of a patch, of all of its images together.

    Parameters
    ----------
    patches : (n, image, v, u) ndarray
        Patches.
    size, step : int
        Pixels of a window each way, and from one to the next.

    Returns
    -------
    (n, row, column, image * size * size) ndarray
        The windows, from the first corner on.
    """
    _check_windows(patches, size)
    windows = sliding_window_view(patches, (size, size), axis=(2, 3))[:, :, ::step, ::step]
    ordered = np.moveaxis(windows, 1, 3)
    return ordered.reshape(*ordered.shape[:3], -1)


def gradient_windows(patches: FloatArray, size: int, step: int) -> FloatArray:
    """Return the gradients' histograms in all windows of a patch, of all of its images together.

    Of each image 4 x 4 cells with 8 directions, scaled to a norm of one, clipped at 0.2 and scaled
    again: the descriptor of SIFT (Lowe, Int. J. Computer Vision 60(2), 2004) upright and in one
    scale, with a flat window and without interpolation of votes.

    Parameters
    ----------
    patches : (n, image, v, u) ndarray
        Patches.
    size, step : int
        Pixels of a window each way, a multiple of 4, and from one to the next.

    Returns
    -------
    (n, row, column, image * 128) ndarray
        The windows, from the first corner on.

    Raises
    ------
    ValueError
        If a window is larger than a patch, or its size is no multiple of 4.
    """
    _check_windows(patches, size)
    if size % LOCAL_CELLS:
        raise ValueError(f"window must have a multiple of {LOCAL_CELLS} pixels, got {size}")
    cell = size // LOCAL_CELLS
    votes = oriented_gradients(patches, LOCAL_BINS, signed=True)
    sums = sliding_window_view(votes, (cell, cell), axis=(3, 4)).sum(axis=(5, 6))
    # Of all cells of a window the first pixel: every cell-th of what begins within it.
    within = size - cell + 1
    windows = sliding_window_view(sums, (within, within), axis=(3, 4))
    windows = windows[:, :, :, ::step, ::step, ::cell, ::cell]
    ordered = np.moveaxis(windows, (1, 2), (3, 6))  # (n, row, column, image, cell, cell, bin)
    vectors = ordered.reshape(*ordered.shape[:4], -1)
    vectors = _unit(np.minimum(_unit(vectors), _CLIP))
    return vectors.reshape(*vectors.shape[:3], -1)


def _check_windows(patches: FloatArray, size: int) -> None:
    """Refuse windows that are larger than a patch."""
    v, u = patches.shape[-2:]
    if not 1 <= size <= min(v, u):
        raise ValueError(f"window must have 1 to {min(v, u)} pixels, got {size}")
