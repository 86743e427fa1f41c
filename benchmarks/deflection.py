"""Time of likelihood maps: a 12 m x 19 m image at 5 cm x 2 cm, HH and VV, range cuts of 28 samples.

Run ``python benchmarks/deflection.py``. All ways take turns within one run; medians are printed with the quartiles.
"""

import time

import numpy as np

from flgpr.detect import ChipDetector, deflection_form
from flgpr.kernels.correlate import chips

ROUNDS = 31
SHAPE = (951, 241)  # y, x


def build(
    rng: np.random.Generator, channels: int, shape: tuple[int, int], rank: int
) -> ChipDetector:
    """Make a detector with moments drawn at random, on whitened data."""
    features = channels * shape[0] * shape[1]
    mean = rng.normal(size=features) + 1j * rng.normal(size=features)
    form = deflection_form(mean, np.eye(features), rank=rank)
    form = form.after(mean, np.eye(features) + 0j)
    return ChipDetector(
        (form,), tuple(f"channel {k}" for k in range(channels)), shape, (0.02, 0.05)
    )


def by_matrix(detector: ChipDetector, image: np.ndarray) -> np.ndarray:
    """Score all chips by one matrix product: the plain way."""
    cuts = chips(image, detector.shape)
    rows = cuts.reshape(-1, detector.forms[0].linear.size)
    return detector.forms[0](rows).reshape(cuts.shape[:2])


def main() -> None:
    """Time every case and print a table."""
    rng = np.random.default_rng(1)
    cases = {
        "M' = 1": build(rng, 2, (28, 1), 1),
        "M' = 3": build(rng, 2, (28, 1), 3),
        "M' = 6": build(rng, 2, (28, 1), 6),
        "M' = 3, 3 polarizations x 4 sub-bands": build(rng, 12, (28, 1), 3),
        "M' = 3, chips of 28 x 13": build(rng, 2, (28, 13), 3),
    }
    images = {
        name: (rng.normal(size=(2, len(d.channels), *SHAPE)).astype(np.float32))
        for name, d in cases.items()
    }
    data = {name: (pair[0] + 1j * pair[1]).astype(np.complex64) for name, pair in images.items()}
    found = cases["M' = 3"].likelihood(data["M' = 3"])
    plain = by_matrix(cases["M' = 3"], data["M' = 3"])
    inner = found[14 : 14 + plain.shape[0]]
    print(
        f"largest relative difference from the plain way: {np.abs(inner - plain).max() / np.abs(plain).max():.1e}"
    )
    times: dict[str, list[float]] = {name: [] for name in [*cases, "M' = 3, one matrix product"]}
    for turn in range(ROUNDS):
        for name, detector in cases.items():
            start = time.perf_counter()
            detector.likelihood(data[name])
            times[name].append(time.perf_counter() - start)
        if turn % 6 == 0:
            start = time.perf_counter()
            by_matrix(cases["M' = 3"], data["M' = 3"])
            times["M' = 3, one matrix product"].append(time.perf_counter() - start)
    for name, taken in times.items():
        low, middle, high = 1e3 * np.quantile(taken[1:], [0.25, 0.5, 0.75])
        print(f"{name:40s} {middle:8.1f} ms  ({low:.1f} to {high:.1f})")


if __name__ == "__main__":
    main()
