"""The model of a designed fraction of a space of axes, and what the fraction can decide."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
Axes = Mapping[str, Sequence[Any]]


def contrasts(levels: int) -> FloatArray:
    """Return orthogonal polynomial contrasts (level, levels - 1).

    Every column has mean 0 and mean square 1. The first column is linear in the number of the
    level, the second quadratic, and so on.
    """
    if levels < 2:
        raise ValueError(f"levels must be at least 2, got {levels}")
    powers = np.vander(np.linspace(-1, 1, levels), increasing=True)
    basis = np.linalg.qr(powers)[0][:, 1:] * np.sqrt(levels)
    return np.asarray(basis * np.sign(basis[-1]))


def terms_of(axes: Axes, interactions: Sequence[tuple[str, str]]) -> list[tuple[str, ...]]:
    """List the terms of a model: the mean, every axis, and the given pairs of axes."""
    return [(), *((axis,) for axis in axes), *interactions]


def model_matrix(
    table: pd.DataFrame, axes: Axes, interactions: Sequence[tuple[str, str]]
) -> FloatArray:
    """Compute the model matrix (row, column) of a table of levels.

    Its columns are in the order of :func:`terms_of`.

    Parameters
    ----------
    table : DataFrame
        A column for every axis.
    axes : mapping of str to sequence
        Levels of every axis.
    interactions : sequence of pairs of str
        Pairs of axes whose interaction is in the model.

    Raises
    ------
    ValueError
        If a value of the table is no level of its axis.
    """
    terms = {}
    for axis, levels in axes.items():
        terms[axis] = contrasts(len(levels))[_level_numbers(table, axis, levels)]
    columns = []
    for term in terms_of(axes, interactions):
        block = np.ones((len(table), 1))
        for axis in term:
            block = (block[:, :, None] * terms[axis][:, None, :]).reshape(len(table), -1)
        columns.append(block)
    return np.concatenate(columns, axis=1)


def term_columns(
    axes: Axes, interactions: Sequence[tuple[str, str]]
) -> dict[tuple[str, ...], slice]:
    """Return which columns of the model matrix belong to each term."""
    columns_of_term: dict[tuple[str, ...], slice] = {}
    start = 0
    for term in terms_of(axes, interactions):
        width = int(np.prod([len(axes[axis]) - 1 for axis in term], dtype=int))
        columns_of_term[term] = slice(start, start + width)
        start += width
    return columns_of_term


def marginal_row(
    levels: Mapping[str, Any], axes: Axes, interactions: Sequence[tuple[str, str]]
) -> FloatArray:
    """Compute the row (column,) of the model matrix for levels of some axes.

    It is the mean over all levels of the other axes.

    Parameters
    ----------
    levels : mapping of str to object
        Level of each axis that is given.
    axes : mapping of str to sequence
        Levels of every axis.
    interactions : sequence of pairs of str
        Pairs of axes whose interaction is in the model.
    """
    contrast_of_level = {}
    for axis, level in levels.items():
        number = list(axes[axis]).index(level)
        contrast_of_level[axis] = contrasts(len(axes[axis]))[number]
    columns_of_term = term_columns(axes, interactions)
    row = np.zeros(max(columns.stop for columns in columns_of_term.values()))
    for term, columns in columns_of_term.items():
        if all(axis in contrast_of_level for axis in term):
            block = np.ones(1)
            for axis in term:
                block = np.outer(block, contrast_of_level[axis]).ravel()
            row[columns] = block
    return row


def _level_numbers(table: pd.DataFrame, axis: str, levels: Sequence[Any]) -> NDArray[np.intp]:
    """Return the index of each row's level; refuse an unknown level."""
    number = {level: index for index, level in enumerate(levels)}
    unknown = [value for value in table[axis] if value not in number]
    if unknown:
        raise ValueError(f"{axis} must be one of {', '.join(map(str, levels))}, got {unknown[0]!r}")
    return np.array([number[value] for value in table[axis]], dtype=np.intp)


def decidable(table: pd.DataFrame, axes: Axes, crossed: tuple[str, str]) -> pd.DataFrame:
    """Return what a table of levels can decide.

    Parameters
    ----------
    table : DataFrame
        A column for every axis.
    axes : mapping of str to sequence
        Levels of every axis.
    crossed : tuple of str
        The two axes whose interaction is in the model.

    Returns
    -------
    DataFrame
        A row per axis and for the interaction: ``term``; ``effects``, its number of independent
        effects; ``error``, the largest standard error of a difference between two of its levels (of
        the interaction: of a difference of two differences), in standard deviations of a world;
        ``inflation``, the largest variance of its effects over that in an orthogonal table of as
        many rows.
    """
    interactions = [crossed]
    matrix = model_matrix(table, axes, interactions)
    covariance = np.linalg.inv(matrix.T @ matrix)
    rows = []
    for term, columns in term_columns(axes, interactions).items():
        if not term:
            continue
        differences = _differences(term, axes, interactions)
        errors = []
        for difference in differences:
            errors.append(float(np.sqrt(difference @ covariance @ difference)))
        variances = np.diag(covariance)[columns] * len(matrix)
        rows.append(
            {
                "term": " x ".join(term),
                "effects": columns.stop - columns.start,
                "error": max(errors),
                "inflation": float(variances.max()),
            }
        )
    return pd.DataFrame(rows)


def _differences(
    term: tuple[str, ...], axes: Axes, interactions: Sequence[tuple[str, str]]
) -> list[FloatArray]:
    """List the differences between two levels of an axis, or those of differences of two axes."""

    def row(*levels: Any) -> FloatArray:
        return marginal_row(dict(zip(term, levels, strict=True)), axes, interactions)

    if len(term) == 1:
        return [row(level) - row(other) for level, other in combinations(axes[term[0]], 2)]
    first, second = term
    several = []
    for low, high in combinations(axes[first], 2):
        for left, right in combinations(axes[second], 2):
            several.append(row(high, right) - row(high, left) - row(low, right) + row(low, left))
    return several
