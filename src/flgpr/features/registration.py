"""Registration of images to the survey by fiducials beside the lane (flsar2004, par. 13)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flgpr.model import Grid
from flgpr.types import ArrayLike, floats


@dataclass(frozen=True)
class SurveyOffset:
    """Offset of an image from the survey."""

    shift: tuple[float, float]  #: image position less surveyed position, x and y, m
    residual: float  #: rms distance of the fiducials from their shifted survey, m
    used: int  #: number of fiducials


def register_fiducials(
    image: ArrayLike, grid: Grid, surveyed: ArrayLike, reach: float = 0.6
) -> SurveyOffset:
    """Estimate the shift from the survey to an image by its fiducials (flsar2004, par. 13).

    Each fiducial is the brightest pixel within ``reach``, refined by the centroid of the power
    around it; the shift is the median over the fiducials, which a single false one does not move.

    Parameters
    ----------
    image : (y, x) array_like
        Magnitude on the grid.
    grid : Grid
        Pixels.
    surveyed : (n, 2) array_like
        x, y of the fiducials, m.
    reach : float
        Farthest they may lie off, m.

    Returns
    -------
    SurveyOffset
        Shift, residual and number of fiducials.

    Raises
    ------
    ValueError
        If no fiducial lies in the image.
    """
    power = np.nan_to_num(floats(image)) ** 2
    in_image = []
    in_survey = []
    for u, v in np.reshape(floats(surveyed), (-1, 2)):
        within = (np.abs(grid.y[:, None] - v) <= reach) & (np.abs(grid.x[None, :] - u) <= reach)
        if not within.any() or not power[within].max() > 0:
            continue
        row, column = np.unravel_index(np.where(within, power, -1).argmax(), power.shape)
        rows = slice(max(row - 2, 0), row + 3)
        columns = slice(max(column - 2, 0), column + 3)
        peak = power[rows, columns]
        x = (peak * grid.x[None, columns]).sum() / peak.sum()
        y = (peak * grid.y[rows, None]).sum() / peak.sum()
        in_image.append((x, y))
        in_survey.append((u, v))
    if not in_image:
        raise ValueError(
            "surveyed must hold a fiducial inside the image, "
            f"got none of {len(np.atleast_2d(surveyed))}"
        )
    offset = np.asarray(in_image) - np.asarray(in_survey)
    shift = np.median(offset, axis=0)
    residual = float(np.sqrt(((offset - shift) ** 2).sum(axis=1).mean()))
    return SurveyOffset((float(shift[0]), float(shift[1])), residual, len(in_image))
