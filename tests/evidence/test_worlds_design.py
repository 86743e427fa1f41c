"""The designed fraction of the space of worlds: what it can tell apart."""

import hashlib
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from worlds.design import (
    contrasts,
    decidable,
    marginal_row,
    model_matrix,
    term_columns,
)
from worlds.detection import CROSSED
from worlds.space import AXES, design_worlds

pytestmark = pytest.mark.slow("studies of papers")

SMALL = {"a": [1, 2], "b": ["x", "y"], "c": [0.5, 1.5]}


@pytest.fixture(scope="module")
def table():
    rows = [
        {axis: getattr(world, axis) for axis in AXES} | {"replicate": world.replicate}
        for world in design_worlds()
    ]
    return pd.DataFrame(rows)


@pytest.mark.parametrize("levels", [2, 3, 4])
def test_contrasts_are_orthogonal_of_mean_square_one_and_free_of_the_mean(levels):
    basis = contrasts(levels)
    np.testing.assert_allclose(basis.T @ basis / levels, np.eye(levels - 1), atol=1e-12)
    np.testing.assert_allclose(basis.sum(axis=0), 0, atol=1e-12)
    assert np.all(np.diff(basis[:, 0]) > 0)


def test_one_level_cannot_be_contrasted():
    with pytest.raises(ValueError, match="levels must be at least 2, got 1"):
        contrasts(1)


def test_an_unknown_level_is_named():
    with pytest.raises(ValueError, match=r"c must be one of 0\.5, 1\.5, got 2"):
        model_matrix(pd.DataFrame({"a": [1], "b": ["x"], "c": [2.0]}), SMALL, [])


def test_every_main_effect_and_the_interaction_can_be_told_apart(table):
    matrix = model_matrix(table, AXES, [CROSSED])
    assert np.linalg.matrix_rank(matrix) == matrix.shape[1] == 23
    assert len(table) - matrix.shape[1] == 41
    what = decidable(table, AXES, CROSSED).set_index("term")
    assert what["effects"].sum() == 22
    assert (what["inflation"] < 1.2).all()
    assert (what.drop(index="roughness x permittivity")["error"] < 0.37).all()


def test_every_cell_has_three_worlds_and_one_again(table):
    first = table[table["replicate"] == 0]
    again = table[table["replicate"] == 1]
    assert (first.groupby(list(CROSSED)).size() == 3).all()
    assert (again.groupby(list(CROSSED)).size() == 1).all()
    assert len(first.drop_duplicates(list(AXES))) == 48
    assert len(again.merge(first, on=list(AXES))) == 16


def test_marginal_rows_average_over_the_other_axes():
    space = pd.MultiIndex.from_product(SMALL.values(), names=SMALL).to_frame(index=False)
    matrix = model_matrix(space, SMALL, [("a", "b")])
    np.testing.assert_allclose(
        marginal_row({"a": 2}, SMALL, [("a", "b")]),
        matrix[space["a"] == 2].mean(axis=0),
        atol=1e-12,
    )
    inside = (space["a"] == 1) & (space["b"] == "y")
    both = marginal_row({"a": 1, "b": "y"}, SMALL, [("a", "b")])
    np.testing.assert_allclose(both, matrix[inside].mean(axis=0), atol=1e-12)
    assert list(term_columns(SMALL, [("a", "b")])) == [(), ("a",), ("b",), ("c",), ("a", "b")]


def test_the_page_names_the_declared_files_and_what_they_can_decide(table):
    root = Path(__file__).parents[2]
    page = (root / "docs" / "evidence" / "worlds.md").read_text(encoding="utf-8")
    for name in ("worlds.toml", "worlds.csv"):
        content = (root / "evidence" / "worlds" / name).read_bytes()
        assert hashlib.sha256(content).hexdigest() in page, (
            f"{name} was declared anew: state its SHA-256 on the page"
        )
    stated = pd.read_csv(root / "docs" / "evidence" / "worlds" / "design.csv")
    decided = decidable(table, AXES, CROSSED)[["term", "effects", "error", "inflation"]]
    assert stated["effect"].tolist() == decided["term"].tolist()
    np.testing.assert_allclose(stated.iloc[:, 1:], decided.iloc[:, 1:], atol=0.0051)
