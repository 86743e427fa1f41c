"""Scores of trees: random forests, boosted trees and isolation forests, as one table of nodes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np

from flgpr.detect.scorers.checks import Checked, StoredScorer, refuse_unless
from flgpr.types import AnyArray, Entries, FloatArray, IntArray, floats

_LEAF = -1
_COLUMNS = ("left", "right", "feature", "split")
_LARGEST_DEPTH = 4096  # nodes on the way to a leaf, more than any forest of alarms has


@dataclass(frozen=True)
class Trees:
    """Binary trees, one after the other in one table of nodes.

    A sample goes from a tree's first node to the left child where its feature is at most the
    threshold, else to the right one, until it is in a leaf. Children have larger numbers than their
    parents, so that every path ends.
    """

    first: IntArray  #: (n_trees,) first node of every tree
    left: IntArray  #: (n_nodes,) left child, -1 in a leaf
    right: IntArray  #: (n_nodes,) right child, -1 in a leaf
    feature: IntArray  #: (n_nodes,) feature that is compared, 0 in a leaf
    split: FloatArray  #: (n_nodes,) threshold, 0 in a leaf
    value: FloatArray  #: (n_nodes,) what a leaf adds

    def total(self, X: AnyArray) -> FloatArray:
        """Return the sums of the leaves that samples reach, over all trees.

        Parameters
        ----------
        X : (n_samples, n_features) ndarray
            Samples.

        Returns
        -------
        (n_samples,) ndarray
            Sums.
        """
        total = np.zeros(len(X))
        for root in self.first:
            node = np.full(len(X), root)
            sample = np.flatnonzero(self.left[node] != _LEAF)  # samples that are not in a leaf yet
            while sample.size:
                parent = node[sample]
                goes_left = X[sample, self.feature[parent]] <= self.split[parent]
                node[sample] = np.where(goes_left, self.left[parent], self.right[parent])
                sample = sample[self.left[node[sample]] != _LEAF]
            total += self.value[node]
        return total

    @classmethod
    def joined(cls, trees: Sequence[Entries]) -> Self:
        """Join trees, each with ``left``, ``right``, ``feature``, ``split`` and ``value``.

        The children of a tree count from its own first node.
        """
        types = {"left": "i8", "right": "i8", "feature": "i8", "split": "f8", "value": "f8"}
        columns: dict[str, list[AnyArray]] = {name: [] for name in types}
        first = []
        count = 0
        for tree in trees:
            leaf = np.asarray(tree["left"]) < 0
            first.append(count)
            for name in ("left", "right"):
                columns[name].append(np.where(leaf, _LEAF, np.asarray(tree[name]) + count))
            for name in ("feature", "split"):
                columns[name].append(np.where(leaf, 0, tree[name]))
            columns["value"].append(floats(tree["value"]))
            count += len(leaf)
        joined = [np.concatenate(columns[name]).astype(of) for name, of in types.items()]
        return cls(np.array(first, dtype=np.int64), *joined)

    @classmethod
    def taken(cls, checked: Checked, features: int) -> Self:
        """Return the table of a file's arrays.

        A path that could leave its tree, or not end, is a ValueError.
        """
        value = checked.array("value", (None,))
        nodes = (len(value),)
        left, right, feature = (checked.array(name, nodes, np.int64) for name in _COLUMNS[:3])
        first = checked.array("first", (None,), np.int64)
        trees = cls(first, left, right, feature, checked.array("split", nodes), value)
        _check_paths(trees, features)
        return trees


def _check_paths(trees: Trees, features: int) -> None:
    """Refuse children that are no later nodes of their tree, unknown features, and deep trees."""
    count = len(trees.value)
    first = trees.first
    in_range = first.size > 0 and first[0] == 0 and first[-1] < count
    rising = in_range and bool((np.diff(first) > 0).all())
    refuse_unless(rising, "array 'first' must rise from 0 within the nodes", first[:5].tolist())

    node = np.arange(count)
    tree = np.searchsorted(first, node, side="right") - 1
    end = np.append(first[1:], count)[tree]  # of the node's own tree
    leaf = trees.left == _LEAF
    no_single_child = bool((leaf == (trees.right == _LEAF)).all())
    refuse_unless(no_single_child, "a node must have two children or none", "one")
    for name, child in (("left", trees.left), ("right", trees.right)):
        later = leaf | ((child > node) & (child < end))
        rule = f"array {name!r} must lead to later nodes of the tree"
        refuse_unless(bool(later.all()), rule, child[~later][:1])

    known = (trees.feature >= 0) & (trees.feature < features)
    rule = f"array 'feature' must be from 0 to {features - 1}"
    refuse_unless(bool(known.all()), rule, trees.feature[~known][:1])

    # Level by level: a file may hold a path as long as its nodes, and every sample would walk it.
    level = first
    for _ in range(_LARGEST_DEPTH):
        parents = level[~leaf[level]]
        if not parents.size:
            return
        level = np.unique(np.concatenate([trees.left[parents], trees.right[parents]]))
    raise ValueError(f"trees must be at most {_LARGEST_DEPTH} nodes deep, got one that is deeper")


def _table_of(tree: Any) -> Entries:
    """Return the nodes of one of scikit-learn's trees."""
    columns = (tree.children_left, tree.children_right, tree.feature, tree.threshold)
    return dict(zip(_COLUMNS, columns, strict=True))


@dataclass(frozen=True)
class ForestScorer(StoredScorer):
    """Compute the log odds of the mean over a random forest's trees.

    A tree gives the share of mines in a sample's leaf.
    """

    trees: Trees
    threshold: float = 0.0

    def __call__(self, X: FloatArray) -> FloatArray:
        """Score samples (n_samples, n_features), which the trees take in single precision."""
        p = self.trees.total(X.astype(np.float32)) / len(self.trees.first)
        return np.log(np.maximum(p, 1e-12)) - np.log(np.maximum(1 - p, 1e-12))

    @classmethod
    def of(cls, estimator: Any) -> Self:
        """Return the scorer of a fitted forest of two classes."""
        tables = []
        for tree_estimator in estimator.estimators_:
            tree = tree_estimator.tree_
            share = tree.value[:, 0, :]
            refuse_unless(share.shape[1] == 2, "estimator must part two classes", share.shape)
            tables.append({**_table_of(tree), "value": share[:, 1] / share.sum(axis=1)})
        return cls(Trees.joined(tables))

    @classmethod
    def taken(cls, checked: Checked, features: int) -> Self:
        """Return the scorer of a file's arrays; shares must lie between 0 and 1."""
        trees = Trees.taken(checked, features)
        is_share = (trees.value >= 0) & (trees.value <= 1)
        rule = "array 'value' must lie between 0 and 1"
        refuse_unless(bool(is_share.all()), rule, trees.value[~is_share][:1])
        return cls(trees)


@dataclass(frozen=True)
class BoostedScorer(StoredScorer):
    """Compute the log odds of boosted trees: a constant and the sum of a sample's leaves."""

    trees: Trees
    baseline: float
    threshold: float = 0.0

    def __call__(self, X: FloatArray) -> FloatArray:
        """Score samples (n_samples, n_features)."""
        return self.baseline + self.trees.total(X)

    @classmethod
    def of(cls, estimator: Any) -> Self:
        """Return the scorer of a fitted estimator of two classes; categories are refused."""
        two_classes = estimator.n_trees_per_iteration_ == 1
        refuse_unless(two_classes, "estimator must part two classes", len(estimator.classes_))
        tables = []
        for (predictor,) in estimator._predictors:
            nodes = predictor.nodes
            categories = int(nodes["is_categorical"].sum())
            rule = "features must be numbers without categories for a detector"
            refuse_unless(categories == 0, rule, categories)
            leaf = nodes["is_leaf"].astype(bool)
            left, right = (
                np.where(leaf, _LEAF, nodes[name].astype(np.int64)) for name in ("left", "right")
            )
            columns = (left, right, nodes["feature_idx"], nodes["num_threshold"])
            tables.append(dict(zip(_COLUMNS, columns, strict=True)) | {"value": nodes["value"]})
        return cls(Trees.joined(tables), float(np.ravel(estimator._baseline_prediction)[0]))

    @classmethod
    def taken(cls, checked: Checked, features: int) -> Self:
        """Return the scorer of a file's settings and arrays."""
        return cls(Trees.taken(checked, features), checked.number("baseline"))


@dataclass(frozen=True)
class IsolationScorer(StoredScorer):
    """Compute the decision function of an isolation forest (Liu, Ting & Zhou 2008).

    It is ``-2^(-d / (n c)) - offset`` of the summed path lengths d in n trees, c being the mean
    length of one tree: samples that few splits isolate score low.
    """

    trees: Trees
    mean_length: float  #: c
    offset: float
    threshold: float = 0.0

    def __call__(self, X: FloatArray) -> FloatArray:
        """Score samples (n_samples, n_features), which the trees take in single precision."""
        lengths = self.trees.total(X.astype(np.float32))
        scale = len(self.trees.first) * self.mean_length
        relative = lengths / scale if scale > 0 else np.ones_like(lengths)
        return -(2.0**-relative) - self.offset

    @classmethod
    def of(cls, estimator: Any) -> Self:
        """Return the scorer of a fitted forest."""
        tables = []
        trees = zip(estimator.estimators_, estimator.estimators_features_, strict=True)
        for tree_estimator, features in trees:
            tree = tree_estimator.tree_
            table = _table_of(tree)
            table["feature"] = np.asarray(features)[np.maximum(tree.feature, 0)]
            table["value"] = _path_lengths(tree)
            tables.append(table)
        lengths = _mean_path_length(np.array([estimator._max_samples]))
        return cls(Trees.joined(tables), float(lengths[0]), float(estimator.offset_))

    @classmethod
    def taken(cls, checked: Checked, features: int) -> Self:
        """Return the scorer of a file's settings and arrays."""
        return cls(
            Trees.taken(checked, features),
            checked.number("mean_length", 0.0),
            checked.number("offset"),
        )


def _path_lengths(tree: Any) -> FloatArray:
    """Return each node's depth plus the mean length of a tree grown from its examples."""
    depth = np.zeros(tree.node_count)
    for node in np.flatnonzero(tree.children_left >= 0):  # children have larger numbers
        depth[[tree.children_left[node], tree.children_right[node]]] = depth[node] + 1
    return depth + _mean_path_length(tree.n_node_samples)


def _mean_path_length(count: AnyArray) -> FloatArray:
    """Return the mean depth of an unsuccessful search among ``count`` examples.

    This is c(n) = 2H(n - 1) - 2(n - 1)/n, Eq. 1 of Liu, Ting & Zhou 2008, with the harmonic number
    H(i) ≈ ln i + γ; of two examples it is 1, as in scikit-learn.
    """
    n = floats(count)
    several = np.maximum(n, 3.0)
    length = 2 * (np.log(several - 1) + np.euler_gamma) - 2 * (several - 1) / several
    return np.select([n <= 1, n == 2], [0.0, 1.0], length)
