"""Features of patches, slowly: HOG, local binary patterns, windows of gradients, words and Fisher vectors.

Written from Dalal & Triggs 2005, Ojala, Pietikäinen & Mäenpää 2002 (Eq. 9), Lowe 2004, Csurka et al. 2004, and
Perronnin, Sánchez & Mensink 2010 (Sec. 2 and 3).
"""

import math

import numpy as np
from scipy.stats import multivariate_normal


def gradient(image, row, column):
    """Central differences down and to the right; zero on the outermost rows and columns."""
    rows, columns = image.shape
    down = image[row + 1, column] - image[row - 1, column] if 0 < row < rows - 1 else 0.0
    right = image[row, column + 1] - image[row, column - 1] if 0 < column < columns - 1 else 0.0
    return down, right


def histogram(image, rows, columns, bins, turn):
    """Sum of the gradients' magnitudes in a region by direction."""
    sums = np.zeros(bins)
    for row in rows:
        for column in columns:
            down, right = gradient(image, row, column)
            direction = math.degrees(math.atan2(down, right)) % turn
            sums[min(int(direction * bins / turn), bins - 1)] += math.hypot(down, right)
    return sums


def clipped_unit(vector, epsilon=1e-5):
    """L2-Hys of Dalal & Triggs, Sec. 6.4, and the same of Lowe, Sec. 6.1."""
    unit = vector / math.sqrt((vector**2).sum() + epsilon**2)
    unit = np.minimum(unit, 0.2)
    return unit / math.sqrt((unit**2).sum() + epsilon**2)


def hog(image, cell, block, bins):
    rows, columns = (length // cell for length in image.shape)
    first = [(length % cell) // 2 for length in image.shape]
    cells = np.zeros((rows, columns, bins))
    for i in range(rows):
        for j in range(columns):
            of_rows = range(first[0] + i * cell, first[0] + (i + 1) * cell)
            of_columns = range(first[1] + j * cell, first[1] + (j + 1) * cell)
            cells[i, j] = histogram(image, of_rows, of_columns, bins, 180.0) / cell**2
    blocks = []
    for i in range(rows - block + 1):
        for j in range(columns - block + 1):
            blocks.append(clipped_unit(cells[i : i + block, j : j + block].ravel()))
    return np.concatenate(blocks)


def gradient_window(image, row, column, size):
    """Descriptor of a window that begins at a pixel."""
    cell = size // 4
    sums = []
    for i in range(4):
        for j in range(4):
            rows = range(row + i * cell, row + (i + 1) * cell)
            columns = range(column + j * cell, column + (j + 1) * cell)
            sums.append(histogram(image, rows, columns, 8, 360.0))
    return clipped_unit(np.concatenate(sums))


def local_binary_pattern(image, row, column):
    """Ojala et al., Eq. 9, with P = 8 and R = 1; a value between pixels is interpolated bilinearly."""
    bits = []
    for number in range(8):
        angle = 2 * math.pi * number / 8
        r, c = row - math.sin(angle), column + math.cos(angle)
        r, c = round(r, 9), round(c, 9)
        r0, c0 = math.floor(r), math.floor(c)
        value = 0.0
        for i, weight_i in ((r0, 1 - (r - r0)), (r0 + 1, r - r0)):
            for j, weight_j in ((c0, 1 - (c - c0)), (c0 + 1, c - c0)):
                if weight_i * weight_j > 0:
                    value += weight_i * weight_j * image[i, j]
        bits.append(value >= image[row, column])
    changes = sum(bits[k] != bits[k - 1] for k in range(8))
    return sum(bits) if changes <= 2 else 9


def fisher_vector(descriptors, share, mean, deviation):
    """Perronnin et al. 2010, Sec. 2: gradients by means, then by standard deviations."""
    count = len(descriptors)
    gaussians, directions = mean.shape
    by_mean = np.zeros((gaussians, directions))
    by_deviation = np.zeros((gaussians, directions))
    for x in descriptors:
        density = np.array(
            [
                share[k] * multivariate_normal.pdf(x, mean[k], np.diag(deviation[k] ** 2))
                for k in range(gaussians)
            ]
        )
        posterior = density / density.sum()
        for k in range(gaussians):
            off = (x - mean[k]) / deviation[k]
            by_mean[k] += posterior[k] * off / (count * math.sqrt(share[k]))
            by_deviation[k] += posterior[k] * (off**2 - 1) / (count * math.sqrt(2 * share[k]))
    return np.concatenate([by_mean.ravel(), by_deviation.ravel()])
