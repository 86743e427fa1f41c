"""Relevance vector machines side by side: flgpr, fastrvm, sklearn-rvm. Times are medians of interleaved runs.

Run ``python evidence/rvm.py [--slow]``; the peers are optional (``pip install fastrvm sklearn-rvm``) and ``--slow``
adds sklearn-rvm at N = 300, which takes minutes. The kernel is the same for all: RBF with the same width.
"""

from __future__ import annotations

import argparse
import sys
import time
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit
from sklearn.datasets import load_breast_cancer, load_digits, load_iris, load_wine
from sklearn.metrics.pairwise import rbf_kernel
from sklearn.model_selection import StratifiedKFold
from sklearn.preprocessing import scale

from flgpr.detect import RelevanceVectorClassifier, leave_one_out
from flgpr.kernels import relevance
from flgpr.scoring import mcnemar_test

sys.path.insert(0, str(Path(__file__).parents[1] / "benchmarks"))
from suite import data

Data = tuple[NDArray[Any], NDArray[Any], float]


def ripley(count: int, seed: int) -> Data:
    """Draw from Ripley's published mixture, with its width of the kernel."""
    return (*data.ripley(count, seed), 4.0)


def data_sets() -> dict[str, Data]:
    """Two-class problems that ship with scikit-learn, and Ripley's."""
    cancer = load_breast_cancer()
    iris = load_iris()
    wine = load_wine()
    digits = load_digits()
    pair = np.isin(digits.target, (3, 8))
    later = iris.target > 0
    sets = {
        "breast cancer": (scale(cancer.data), cancer.target, 1 / 30),
        "iris, versicolor or not": (scale(iris.data), (iris.target == 1).astype(int), 0.25),
        "iris, versicolor or virginica": (scale(iris.data[later]), iris.target[later] - 1, 0.25),
        "wine, second or not": (scale(wine.data), (wine.target == 1).astype(int), 1 / 13),
        "digits, 3 or 8": (digits.data[pair] / 16, (digits.target[pair] == 8).astype(int), 0.1),
    }
    return sets | {
        f"Ripley {n}, draw {s}": ripley(n, s) for n, s in ((250, 0), (250, 1), (250, 2), (600, 0))
    }


def ours(X: NDArray[Any], y: NDArray[Any], gamma: float) -> Any:
    """Fit ours without a bias, as fastrvm does by default."""
    return RelevanceVectorClassifier(gamma=gamma, bias=False).fit(X, y)


def fast(X: NDArray[Any], y: NDArray[Any], gamma: float) -> Any:
    """Fit fastrvm."""
    from fastrvm import RVC

    return RVC(kernel="rbf", gamma=gamma).fit(X, y)


def slow(X: NDArray[Any], y: NDArray[Any], gamma: float) -> Any:
    """Fit sklearn-rvm."""
    from sklearn_rvm import EMRVC

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return EMRVC(kernel="rbf", gamma=gamma).fit(X, y)


def evidence(X: NDArray[Any], y: NDArray[Any], gamma: float, machine: Any) -> float:
    """Laplace's log evidence by one routine for all, at precisions recovered from the weights.

    At the mode of the weights the gradient vanishes, φᵀ(t - y) = α w, which gives α whatever scale a package uses
    inside; sklearn-rvm's few weights whose α would not be positive are left out.
    """
    if hasattr(machine, "mu_"):
        K = rbf_kernel(machine.relevance_vectors_, X, gamma=gamma) / machine._scale
        K = np.vstack([np.ones(len(X)), K]) if len(machine.mu_) > len(K) else K
        weights = machine.mu_
    else:
        K = rbf_kernel(machine.relevance_vectors_, X, gamma=gamma)
        weights = np.ravel(machine.dual_coef_)
    alpha = K @ (y - expit(weights @ K)) / weights
    good = alpha > 0
    t = y.astype(float)
    rows = np.ascontiguousarray(K[good])
    return float(relevance.laplace(rows, t, 0.0, alpha[good], weights[good]).evidence)


def errors(
    fit: Callable[..., Any], X: NDArray[Any], y: NDArray[Any], gamma: float
) -> NDArray[np.bool_]:
    """Which examples five-fold cross-validation gets wrong."""
    wrong = np.zeros(len(y), np.bool_)
    for train, test in StratifiedKFold(5, shuffle=True, random_state=0).split(X, y):
        wrong[test] = fit(X[train], y[train], gamma).predict(X[test]) != y[test]
    return wrong


def seconds(calls: dict[str, Callable[[], Any]], repeats: int) -> dict[str, float]:
    """Median times of calls that take turns."""
    taken: dict[str, list[float]] = {name: [] for name in calls}
    for _ in range(repeats):
        for name, call in calls.items():
            start = time.perf_counter()
            call()
            taken[name].append(time.perf_counter() - start)
    return {name: float(np.median(times)) for name, times in taken.items()}


def quality() -> None:
    """Print log evidence, number of vectors and error on every data set."""
    print(
        "| data | ours: evidence, vectors, error | fastrvm | difference of evidence | only ours, only theirs wrong |"
    )
    print("|---|---|---|---|---|")
    total = np.zeros(2, np.int64)
    for name, (X, y, gamma) in data_sets().items():
        a = ours(X, y, gamma)
        b = fast(X, y, gamma)
        mine = a.log_evidence_
        own = evidence(X, y, gamma, b)
        check = evidence(X, y, gamma, a)
        if abs(check - mine) > 1e-3:
            print(f"our evidence does not check: {mine:.4f}, {check:.4f}")
        wrong = [errors(fit, X, y, gamma) for fit in (ours, fast)]
        cells = [
            f"{e:.2f}, {len(m.relevance_)}, {100 * w.mean():.1f} %"
            for e, m, w in ((mine, a, wrong[0]), (own, b, wrong[1]))
        ]
        only = np.array([(wrong[0] & ~wrong[1]).sum(), (wrong[1] & ~wrong[0]).sum()])
        total += only
        print(
            f"| {name} (N = {len(y)}) | {cells[0]} | {cells[1]} | {mine - own:+.3f} | {only[0]}, {only[1]} |",
            flush=True,
        )
    # McNemar's exact test of all sets together, though the sets differ.
    print(f"only ours wrong {total[0]}, only theirs {total[1]}: p = {mcnemar_test(*total):.2f}")


def speed() -> None:
    """Print times as ratios."""
    for name, (X, y, gamma) in (
        ("Ripley", ripley(600, 1)),
        ("breast cancer", data_sets()["breast cancer"]),
    ):
        took = seconds({"ours": lambda: ours(X, y, gamma), "fastrvm": lambda: fast(X, y, gamma)}, 7)  # noqa: B023
        print(
            f"{name}, N = {len(y)}: fastrvm takes {took['fastrvm'] / took['ours']:.1f} times as long as ours"
        )
    X, y, gamma = ripley(153, 2)
    machine = RelevanceVectorClassifier(gamma=gamma)
    runs: dict[str, Any] = {}
    for name, warm in (("cold", False), ("warm", True)):
        start = time.perf_counter()
        busy = time.process_time()
        runs[name] = leave_one_out(machine, X, y, warm=warm)[1]
        took = time.perf_counter() - start
        busy = time.process_time() - busy
        print(f"leave-one-out, N = 153, {name}: {took:.1f} s, {busy:.1f} s of processor time")
    gain = np.array(
        [w.log_evidence_ - c.log_evidence_ for w, c in zip(runs["warm"], runs["cold"], strict=True)]
    )
    print(
        f"warm less cold log evidence: {(np.abs(gain) < 1e-3).sum()} of {len(gain)} folds within 0.001, "
        f"{gain.min():+.3f} to {gain.max():+.3f}"
    )


def against_sklearn_rvm() -> None:
    """Print quality and time against sklearn-rvm at N = 300, one run each."""
    cancer = data_sets()["breast cancer"]
    for name, (X, y, gamma) in {
        "Ripley": ripley(300, 0), "breast cancer": (cancer[0][:300], cancer[1][:300], cancer[2])
    }.items():  # fmt: skip
        start = time.perf_counter()
        peer = slow(X, y, gamma)
        middle = time.perf_counter()
        mine = ours(X, y, gamma)
        end = time.perf_counter()
        test = ripley(2000, 9) if name == "Ripley" else (cancer[0][300:], cancer[1][300:], gamma)
        wrong = [100 * float(np.mean(one.predict(test[0]) != test[1])) for one in (mine, peer)]
        print(
            f"{name}, N = 300: sklearn-rvm takes {(middle - start) / (end - middle):.0f} times as long; evidence "
            f"{mine.log_evidence_:.2f} against {evidence(X, y, gamma, peer):.2f}, test error {wrong[0]:.1f} % "
            f"against {wrong[1]:.1f} %, vectors {len(mine.relevance_)} against {len(peer.relevance_)}",
            flush=True,
        )


def main() -> None:
    """Run what was asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--slow", action="store_true", help="also against sklearn-rvm, minutes")
    slow_too = parser.parse_args().slow
    ours(*ripley(60, 0))
    speed()
    quality()
    if slow_too:
        against_sklearn_rvm()


if __name__ == "__main__":
    main()
