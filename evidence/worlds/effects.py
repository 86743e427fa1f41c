"""Effects of axes on what is found, with intervals from the spread of worlds and not of mines.

Mines of one lane share its ground, so that a lane's count is one observation. Its variance may
exceed the binomial one by a factor that is estimated from the worlds themselves (McCullagh & Nelder
1989, Sec. 4.5).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray
from scipy.special import expit, fdtrc, stdtrit

FloatArray = NDArray[np.float64]
Interval = tuple[float, float, float]
LEVEL = 0.95
"""Level of all intervals."""
_STEPS = 200
_CONVERGED = 1e-8


@dataclass(frozen=True)
class Fit:
    """Coefficients of a linear predictor, and how well they are known."""

    coefficient: FloatArray  #: (column,)
    covariance: FloatArray  #: (column, column), dispersion included
    freedom: int  #: degrees of freedom of the dispersion
    #: variance of a world: of a share in units of the binomial one, at least 1; of a mean as it is
    dispersion: float
    logistic: bool  #: whether the linear predictor is the logit of a share

    def value(self, row: ArrayLike) -> Interval:
        """Estimate the response at a row of the model matrix, with its interval."""
        value, low, high = self.linear(row)
        if not self.logistic:
            return value, low, high
        return float(expit(value)), float(expit(low)), float(expit(high))

    def linear(self, row: ArrayLike) -> Interval:
        """Estimate the linear predictor at a row, or its difference between two rows.

        The interval is Student's.
        """
        vector = np.asarray(row, dtype=np.float64)
        value = float(vector @ self.coefficient)
        error = float(np.sqrt(vector @ self.covariance @ vector))
        half = float(stdtrit(self.freedom, (1 + LEVEL) / 2)) * error
        return value, value - half, value + half

    def difference(self, row: ArrayLike, other: ArrayLike) -> Interval:
        """Estimate the response at a row less that at another, with its interval.

        Of shares the interval is by the delta method.
        """
        first = np.asarray(row, dtype=np.float64)
        second = np.asarray(other, dtype=np.float64)
        if not self.logistic:
            return self.linear(first - second)
        shares = expit([first @ self.coefficient, second @ self.coefficient])
        slopes = shares * (1 - shares)
        gradient = slopes[0] * first - slopes[1] * second
        error = float(np.sqrt(gradient @ self.covariance @ gradient))
        half = float(stdtrit(self.freedom, (1 + LEVEL) / 2)) * error
        gap = float(shares[0] - shares[1])
        return gap, gap - half, gap + half

    def p_value(self, columns: slice) -> float:
        """Compute the p-value of all coefficients of some columns being zero (Wald's F test)."""
        coefficients = self.coefficient[columns]
        statistic = (
            coefficients
            @ np.linalg.solve(self.covariance[columns, columns], coefficients)
            / coefficients.size
        )
        return float(fdtrc(coefficients.size, self.freedom, statistic))


def fit_shares(matrix: FloatArray, n_found: ArrayLike, count: ArrayLike) -> Fit:
    """Fit logits of shares by a bias-reduced binomial model.

    Its variance may exceed the binomial one.

    Firth's (1993) penalty keeps estimates finite where all mines or none are found. The dispersion
    is Pearson's, not below 1, so that intervals never get shorter than binomial ones.

    Parameters
    ----------
    matrix : (world, column) ndarray
        Model matrix.
    n_found, count : (world,) array_like
        How many targets were found, and how many there were.

    Raises
    ------
    ValueError
        If there are no more worlds than columns, or the columns depend on each other.
    """
    _check(matrix)
    hits = np.asarray(n_found, dtype=np.float64)
    trials = np.asarray(count, dtype=np.float64)
    coefficient = np.zeros(matrix.shape[1])
    for _ in range(_STEPS):
        share = expit(matrix @ coefficient)
        weight = trials * share * (1 - share)
        inverse = np.linalg.inv(matrix.T @ (weight[:, None] * matrix))
        leverage = weight * np.einsum("ij,jk,ik->i", matrix, inverse, matrix)
        step = inverse @ (matrix.T @ (hits - trials * share + leverage * (0.5 - share)))
        size = float(np.abs(matrix @ step).max())
        # At most 1 logit at a time: longer steps may go back and forth.
        shortening = min(1.0, 1.0 / size if size > 0 else 1.0)
        coefficient = coefficient + step * shortening
        if size < _CONVERGED:
            break
    freedom = len(matrix) - matrix.shape[1]
    share = expit(matrix @ coefficient)
    weight = trials * share * (1 - share)
    pearson = float((((hits - trials * share) ** 2) / weight).sum())
    dispersion = max(1.0, pearson / freedom)
    covariance = np.linalg.inv(matrix.T @ (weight[:, None] * matrix)) * dispersion
    return Fit(coefficient, covariance, freedom, dispersion, True)


def fit_means(matrix: FloatArray, values: ArrayLike) -> Fit:
    """Fit means of a number per world by least squares; worlds without one (NaN) are left out.

    Parameters
    ----------
    matrix : (world, column) ndarray
        Model matrix.
    values : (world,) array_like
        The number in every world.

    Raises
    ------
    ValueError
        If there are no more worlds than columns, or the columns depend on each other.
    """
    numbers = np.asarray(values, dtype=np.float64)
    known = np.isfinite(numbers)
    matrix = matrix[known]
    numbers = numbers[known]
    _check(matrix)
    inverse = np.linalg.inv(matrix.T @ matrix)
    coefficient = inverse @ (matrix.T @ numbers)
    freedom = len(matrix) - matrix.shape[1]
    variance = float(((numbers - matrix @ coefficient) ** 2).sum()) / freedom
    return Fit(coefficient, inverse * variance, freedom, variance, False)


def _check(matrix: FloatArray) -> None:
    """Refuse a matrix that cannot be fitted: too few rows or dependent columns."""
    rows, columns = matrix.shape
    rank = int(np.linalg.matrix_rank(matrix))
    if rows <= columns or rank < columns:
        raise ValueError(
            f"matrix must have more rows than columns and full rank, got {rows} x {columns}, rank "
            f"{rank}"
        )


def block_differences(values: pd.DataFrame, baseline: str) -> pd.DataFrame:
    """Compare every column with a baseline, in rows that are alike in all else (randomised blocks).

    The error of a difference comes from what is left of all columns once the means of columns and
    rows are taken away, ``(columns - 1)·(rows - 1)`` degrees of freedom.

    Parameters
    ----------
    values : DataFrame
        A row per replicate and a column per treatment.
    baseline : str
        Column that the others are compared with.

    Returns
    -------
    DataFrame
        A row per other column: ``change``, its name; ``difference``, ``low`` and ``high``, the 95 %
        interval; ``clear``, whether zero lies outside an interval that is to hold for all rows
        together (Bonferroni). With one replicate there is no interval, which then is infinite.

    Raises
    ------
    ValueError
        If there is no such column, or no other one.
    """
    if baseline not in values or values.shape[1] < 2:
        raise ValueError(
            f"values must hold {baseline!r} and another column, got {', '.join(map(str, values))}"
        )
    data = values.to_numpy(dtype=np.float64)
    rows, columns = data.shape
    rest = data - data.mean(axis=0) - data.mean(axis=1, keepdims=True) + data.mean()
    freedom = (columns - 1) * (rows - 1)
    error = np.sqrt((rest**2).sum() / freedom * 2 / rows) if freedom else np.inf
    half = stdtrit(freedom, (1 + LEVEL) / 2) * error if freedom else np.inf
    wide = stdtrit(freedom, 1 - (1 - LEVEL) / 2 / (columns - 1)) * error if freedom else np.inf
    differences = []
    for name in values.columns:
        if name != baseline:
            gap = float((values[name] - values[baseline]).mean())
            row = {"change": name, "difference": gap, "low": gap - half, "high": gap + half}
            differences.append(row | {"clear": bool(abs(gap) > wide)})
    return pd.DataFrame(differences)
