"""Designed fractions of a space of axes: D-optimal tables, and what they can decide."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations, product
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
Axes = Mapping[str, Sequence[Any]]
# of the logarithm of a determinant: candidates that differ by rounding alone count as equal
_DIGITS = 9


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


def d_optimal(
    axes: Axes, crossed: tuple[str, str], each: int, repeats: int, seed: int, starts: int = 20
) -> pd.DataFrame:
    """Design a fraction that resolves all main effects and the interaction of two axes.

    The two ``crossed`` axes are fully crossed, with ``each`` rows in every cell. The levels of the
    other axes maximise the determinant of the information matrix (D-optimality) by coordinate
    exchange (Meyer & Nachtsheim 1995) from ``starts`` random tables. Then ``repeats`` rows of every
    cell, chosen by the same criterion, come a second time.

    Returns
    -------
    DataFrame
        A column per axis, and ``replicate``, 0 or 1; the rows of each replicate in a random order.
    """
    rng = np.random.default_rng(seed)
    space = pd.DataFrame(list(product(*axes.values())), columns=list(axes))
    every_row = model_matrix(space, axes, [crossed])
    shape = tuple(len(levels) for levels in axes.values())
    best = np.zeros((0, len(axes)), dtype=np.intp)
    best_value = -np.inf
    for _ in range(starts):
        levels, value = _exchange(
            _random_levels(axes, crossed, each, rng), every_row, shape, _free(axes, crossed)
        )
        if value > best_value:
            best = levels
            best_value = value
    chosen = np.array(np.ravel_multi_index(tuple(best.T), shape), dtype=np.intp)
    first = chosen[rng.permutation(len(chosen))]
    tables = [space.iloc[first].assign(replicate=0)]
    if repeats > 0:
        rows = _repeated_rows(every_row[chosen], each, repeats, starts, rng)
        tables.append(space.iloc[chosen[rng.permutation(rows)]].assign(replicate=1))
    return pd.concat(tables, ignore_index=True)


def _free(axes: Axes, crossed: tuple[str, str]) -> list[int]:
    """Return the numbers of the axes that are not crossed."""
    return [number for number, axis in enumerate(axes) if axis not in crossed]


def _random_levels(
    axes: Axes, crossed: tuple[str, str], each: int, rng: np.random.Generator
) -> NDArray[np.intp]:
    """Draw numbers of levels (row, axis).

    The cells of the crossed axes are in order; the levels of the others are drawn in equal numbers
    in random order.
    """
    rows = each * len(axes[crossed[0]]) * len(axes[crossed[1]])
    levels = np.zeros((rows, len(axes)), dtype=np.intp)
    for number, axis in enumerate(axes):
        count = len(axes[axis])
        if axis == crossed[0]:
            levels[:, number] = np.arange(rows) * count // rows
        elif axis == crossed[1]:
            levels[:, number] = np.arange(rows) // each % count
        else:
            levels[:, number] = rng.permutation(np.resize(np.arange(count), rows))
    return levels


def _exchange(
    levels: NDArray[np.intp], every_row: FloatArray, shape: tuple[int, ...], free: Sequence[int]
) -> tuple[NDArray[np.intp], float]:
    """Change one level at a time to the best one until nothing improves.

    Returns the levels and the log determinant.
    """
    matrix = every_row[np.ravel_multi_index(tuple(levels.T), shape)]
    value = _log_determinant(matrix.T @ matrix)
    improved = True
    while improved:
        improved = False
        for row, axis in product(range(len(levels)), free):
            candidates = np.tile(levels[row], (shape[axis], 1))
            candidates[:, axis] = np.arange(shape[axis])
            rows = every_row[np.ravel_multi_index(tuple(candidates.T), shape)]
            without = matrix.T @ matrix - np.outer(matrix[row], matrix[row])
            values = [
                _log_determinant(without + np.outer(candidate, candidate)) for candidate in rows
            ]
            choice = int(np.argmax(values))
            if values[choice] > value:
                levels[row, axis] = choice
                matrix[row] = rows[choice]
                value = values[choice]
                improved = True
    return levels, value


def _repeated_rows(
    matrix: FloatArray, each: int, repeats: int, starts: int, rng: np.random.Generator
) -> NDArray[np.intp]:
    """Choose which rows of every cell are repeated, one exchange at a time.

    The search starts from several random choices.
    """
    options = np.array(list(combinations(range(each), repeats)))
    cells = len(matrix) // each
    information = matrix.T @ matrix

    def rows_of(choice: NDArray[np.intp]) -> NDArray[np.intp]:
        return np.asarray((np.arange(cells)[:, None] * each + options[choice]).ravel())

    def value_of(choice: NDArray[np.intp]) -> float:
        again = matrix[rows_of(choice)]
        return _log_determinant(information + again.T @ again)

    best = np.zeros(cells, dtype=np.intp)
    best_value = -np.inf
    for _ in range(starts):
        choice = rng.integers(len(options), size=cells)
        value = value_of(choice)
        improved = True
        while improved:
            improved = False
            for cell, option in product(range(cells), range(len(options))):
                tried = choice.copy()
                tried[cell] = option
                if value_of(tried) > value:
                    choice = tried
                    value = value_of(tried)
                    improved = True
        if value > best_value:
            best = choice
            best_value = value
    return rows_of(best)


def _log_determinant(information: FloatArray) -> float:
    """Return the rounded log determinant of an information matrix; -inf if it is singular."""
    sign, value = np.linalg.slogdet(information)
    return round(float(value), _DIGITS) if sign > 0 else -np.inf


def _level_numbers(table: pd.DataFrame, axis: str, levels: Sequence[Any]) -> NDArray[np.intp]:
    """Return the index of each row's level; refuse an unknown level."""
    number = {level: index for index, level in enumerate(levels)}
    unknown = [value for value in table[axis] if value not in number]
    if unknown:
        raise ValueError(f"{axis} must be one of {', '.join(map(str, levels))}, got {unknown[0]!r}")
    return np.array([number[value] for value in table[axis]], dtype=np.intp)


def efficiency(matrix: FloatArray) -> float:
    """Compute the D-efficiency of a model matrix (row, column).

    It is 1 for an orthogonal table of as many rows, and 0 where effects alias.
    """
    rows, columns = matrix.shape
    sign, value = np.linalg.slogdet(matrix.T @ matrix / rows)
    return float(np.exp(value / columns)) if sign > 0 else 0.0


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
