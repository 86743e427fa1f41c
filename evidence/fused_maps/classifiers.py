"""Experiments with classifiers that are trained on simulated bodies in measured ground."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from sklearn.ensemble import HistGradientBoostingClassifier
from sklearn.linear_model import LogisticRegression
from sklearn.neural_network import MLPClassifier
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

from fused_maps.lanes import BANDS, FOUR, LOW, Lane
from fused_maps.learnt import Clutter, Trained, ratios_of
from fused_maps.looks_at_some import (
    Looks,
    all_looks,
    free_places,
    looks_at_some,
    put_in_bodies,
    ring_powers,
)
from fused_maps.scores import Bench
from fused_maps.signatures import CLASSES


def features_of(some: Looks, known: Sequence[tuple[Clutter, dict[str, list]]]) -> np.ndarray:
    """Return the features (place, feature): mean ratios of all classes, and contrasts, dB."""
    columns = []
    for clutter, directions in known:
        chips = some.chip[:, :, list(clutter.bands)].reshape(len(some.chip), -1)
        white = clutter.whitened(chips, some.metre)
        for found in directions.values():
            columns.append(some.mean(ratios_of(white, some.metre, found)))
    decibels = some.decibels()
    for polarization in range(3):
        for band in range(len(BANDS)):
            columns.append(some.mean(decibels[:, polarization, band]))
    return np.stack(columns, axis=1)


def log_odds(p: np.ndarray, least: float) -> np.ndarray:
    """Return the log odds of probabilities, none nearer to 0 and 1 than the least."""
    p = np.clip(p, least, 1 - least)
    return np.log(p) - np.log1p(-p)


def examples(
    bench: Bench, trained: Trained, rings: dict[int, np.ndarray], mines: int, ground: int
) -> Iterator[tuple[Looks, int]]:
    """Yield looks at drawn places of every lane and their label: bodies put in 1, ground as it is 0."""
    rng = np.random.default_rng(51)
    for lane in trained.lanes:
        free = free_places(lane)
        with_bodies = looks_at_some(lane, rings[id(lane)], rng.choice(free, mines))
        put_in_bodies(with_bodies, lane, bench, rng)
        yield with_bodies, 1
        yield looks_at_some(lane, rings[id(lane)], rng.choice(free, ground, replace=False)), 0


def try_injected(bench: Bench) -> None:
    """Train classifiers on bodies put into the ground of the other sites."""
    rings = {id(lane): ring_powers(lane) for lane in bench.lanes}

    def learn(trained: Trained):
        known = [trained.classes(bands) for bands in (LOW, FOUR)]
        features, labels = [], []
        for some, label in examples(bench, trained, rings, 250, 1500):
            features.append(features_of(some, known))
            labels.append(np.full(some.count, label))
        return known, np.concatenate(features), np.concatenate(labels)

    learnt = bench.by_site(learn)
    shown = {}
    for lane in bench.lanes:
        shown[id(lane)] = features_of(all_looks(lane, rings[id(lane)]), learnt[lane.site][0])
    low = [*range(4), *(8 + 7 * polarization + band for polarization in range(3) for band in LOW)]
    every = list(range(shown[id(bench.lanes[0])].shape[1]))
    for title, columns in (("three sub-bands", low), ("four and all contrasts", every)):
        for name, make in (
            ("logistic regression", _logistic), ("trees, boosted", _boosted), ("network", _network),
        ):  # fmt: skip
            fitted = {}
            for site, (_, features, labels) in learnt.items():
                fitted[site] = make().fit(features[:, columns], labels)

            def value(lane: Lane, columns=columns, fitted=fitted) -> np.ndarray:
                features = shown[id(lane)][:, columns]
                seen = np.isfinite(features).all(axis=1)
                odds = np.full(lane.places, np.nan)
                p = fitted[lane.site].predict_proba(features[seen])[:, 1]
                odds[seen] = log_odds(p, 1e-12)
                return odds.reshape(lane.rows, lane.columns)

            bench.tell(f"injected bodies, {title}, {name}", value)


def _logistic():
    model = LogisticRegression(C=0.1, max_iter=300, class_weight="balanced")
    return make_pipeline(StandardScaler(), model)


def _boosted():
    return HistGradientBoostingClassifier(
        max_iter=150, learning_rate=0.06, max_leaf_nodes=15, l2_regularization=5.0,
        min_samples_leaf=40, random_state=0,
    )  # fmt: skip


def _network():
    model = MLPClassifier((32,), alpha=1.0, max_iter=100, early_stopping=True, random_state=0)
    return make_pipeline(StandardScaler(), model)


def try_chips(bench: Bench) -> None:
    """Train a network on the whitened chips of single looks; the map is its mean log odds.

    It sees a chip over its own power in 24 directions of all bodies, turned so that the first is
    real, how much power lies outside of them, and the contrast in HH and VV.
    """
    everything = [body for bodies in CLASSES.values() for body in bodies]
    rings = {id(lane): ring_powers(lane) for lane in bench.lanes}

    def inputs(some: Looks, clutter: Clutter, directions: list) -> np.ndarray:
        chips = some.chip[:, :, list(LOW)]
        white = clutter.whitened(chips.reshape(len(chips), -1), some.metre)
        white = white / np.linalg.norm(white, axis=1)[:, None]
        part = np.empty((len(white), 24), np.complex64)
        for metre in np.unique(some.metre):
            at = some.metre == metre
            part[at] = white[at] @ directions[metre][0].T
        part = part * np.exp(-1j * np.angle(part[:, :1]))
        rest = np.log(np.maximum(1 - (np.abs(part) ** 2).sum(axis=1), 1e-3))
        decibels = some.decibels()[:, :2, list(LOW)]
        return np.column_stack([part.real, part.imag, rest, decibels.reshape(len(chips), -1)])

    def learn(trained: Trained):
        clutter = trained.clutter(LOW)
        directions = trained.directions(clutter, everything, 24)
        shown, labels = [], []
        for some, label in examples(bench, trained, rings, 1000, 2000):
            shown.append(inputs(some, clutter, directions))
            labels.append(np.full(len(shown[-1]), label))
        model = MLPClassifier((64,), alpha=0.1, max_iter=60, early_stopping=True, random_state=0)
        fitted = make_pipeline(StandardScaler(), model)
        return clutter, directions, fitted.fit(np.concatenate(shown), np.concatenate(labels))

    learnt = bench.by_site(learn)

    def value(lane: Lane) -> np.ndarray:
        clutter, directions, network = learnt[lane.site]
        looks = all_looks(lane, rings[id(lane)])
        p = network.predict_proba(inputs(looks, clutter, directions))[:, 1].astype(float)
        return lane.mean(log_odds(p, 1e-9))

    bench.tell("injected bodies, network on whitened chips of a look", value)
