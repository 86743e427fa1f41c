"""Echoes of buried targets: the weights of a table's nodes."""

import numpy as np

from flgpr.simulate.bodies.signature import table as nodes
from flgpr.simulate.bodies.targets import node_weights


def test_weights_are_those_of_polynomials_even_and_odd():
    rng = np.random.default_rng(1)
    sine = rng.uniform(nodes.SINE.min(), nodes.SINE.max(), 20)
    apart = rng.uniform(-0.5, 0.5, 20)
    weight = node_weights(sine, apart, np.zeros(20), np.zeros(1))[0]
    np.testing.assert_allclose(weight[:, :, 0].sum(axis=(0, 1)), 1, atol=1e-12)

    def even(s, p):
        return (1 - 2 * s + s**5) * (1 + 3 * p**2 - p**4)

    def odd(s, p):
        return (2 - s**3) * (p - 0.5 * p**3)

    for row, function in ((0, even), (2, odd)):
        at_nodes = function(nodes.SINE[:, None], nodes.SEPARATION)
        got = np.einsum("spn,sp->n", weight[:, :, row], at_nodes)
        np.testing.assert_allclose(got, function(sine, apart), atol=1e-11)
