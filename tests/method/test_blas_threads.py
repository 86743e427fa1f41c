"""The threads of linear algebra change no bit of a detection."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

import flgpr

pytestmark = pytest.mark.slow("processes of their own")

SCRIPT = """
import hashlib
import json
import os

import numpy as np
from threadpoolctl import threadpool_info

from flgpr.engine import Engine, PlannedPass, sum_accumulator
from flgpr.clutter import ClutterWhitener, early_basis, subtract_early


def digest(*arrays):
    content = b"".join(np.ascontiguousarray(array).tobytes() for array in arrays)
    return hashlib.sha256(content).hexdigest()


random = np.random.default_rng(0)
data = random.normal(size=(64, 401)) + 1j * random.normal(size=(64, 401))
basis = early_basis(0.5e9 + 5e6 * np.arange(401), 6.0)
digests = {"early": digest(basis, subtract_early(100 * data, basis))}

samples = random.normal(size=(3000, 200))
for name in ("eigen", "cholesky", "symmetric"):
    whitener = ClutterWhitener(basis=name).fit(samples)
    digests[name] = digest(whitener.matrix_, whitener.transform(samples))


def start(block):
    sums = {"products": np.zeros((401, 401), complex)}

    def add(index):
        sums["products"] += (index + data).T @ data.conj()

    def result():
        values, vectors = np.linalg.eigh(sums["products"])
        return {"values": values, "vectors": vectors}

    return sum_accumulator(sums, add, result)


for concurrent in (False, True):
    engine = Engine([PlannedPass("products", "products", start)], 40, {}, concurrent)
    engine.run()
    digests[f"engine {concurrent}"] = digest(*engine.results["products"].values())
    # The caller has the threads again that it had.
    [left] = {library["num_threads"] for library in threadpool_info() if library["user_api"] == "blas"}
    assert left == int(os.environ["OPENBLAS_NUM_THREADS"])
assert digests["engine True"] == digests["engine False"]
print(json.dumps(digests))
"""


def digests_of(threads):
    """Return digests that a new process computes with so many threads of linear algebra."""
    environment = os.environ | {
        "OPENBLAS_NUM_THREADS": threads,
        "NUMBA_NUM_THREADS": "2",
        "PYTHONPATH": str(Path(flgpr.__file__).parents[1]),
    }
    call = [sys.executable, "-c", SCRIPT]
    done = subprocess.run(call, env=environment, capture_output=True, text=True, check=True)
    return json.loads(done.stdout)


def test_one_and_two_threads_give_the_same_bits():
    one = digests_of("1")
    assert set(one) == {"early", "eigen", "cholesky", "symmetric", "engine False", "engine True"}
    assert digests_of("2") == one
