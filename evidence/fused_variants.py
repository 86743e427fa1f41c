"""Variants of `fused`, tried on training and validation lanes of proving ground 2 with one site left out.

``python evidence/fused_variants.py GROUND OUT [--tier T] [--only NAME ...] [--without-further]`` reads the training and
validation lanes of a folder of ``flgpr benchmark run``. It never reads a test lane. It makes one further lane each in
earth and gravel (180 m, 40 mines of the sorts of the training lanes, seeds of its own), simulates signatures, and cuts
the chips of all looks at a raster of 0.2 m out of the cleaned images of seven sub-bands. What takes long is written to
OUT once.

Everything that is learnt comes from the metal and plastic lanes of the three other sites of the tier. A variant is a
map on the raster: the mean over looks, weighted by the inverse square of their distance, smoothed by 0.15 m. Its local
maxima within 0.5 m are alarms. So the figures are near those of the recipe, not the same.

A row tells mines found at 0.005, 0.01, 0.02 and 0.05 false alarms per m², by kind; of all mines those that the variant
alone and the reference alone find at 0.02, with the p of McNemar's exact test; and the change against the reference of
the mean of log10 of the false alarms at which a mine is found, with its standard error.

Names of experiments: ``bands`` (sub-bands, classes of bodies), ``weights`` (of looks), ``covariance`` (the lane's own),
``looks`` (several looks jointly, with and without their phases), ``offsets`` (narrow subspaces for places beside the
raster), ``injected`` and ``chips`` (classifiers of places, and of chips, trained on simulated bodies put into measured
ground), ``ignorance`` (what it costs not to know which signature it is).
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np

from flgpr_ground.ground import load_ground

sys.path.append(str(Path(__file__).parent))
from fused_maps.classifiers import try_chips, try_injected
from fused_maps.combinations import try_bands, try_covariance, try_looks, try_offsets, try_weights
from fused_maps.ignorance import try_ignorance
from fused_maps.lanes import LOW, Lane, load_lanes
from fused_maps.learnt import ratios_of
from fused_maps.scores import Bench, level
from fused_maps.signatures import BODIES, simulate_signatures

EXPERIMENTS = {
    "bands": try_bands,
    "weights": try_weights,
    "covariance": try_covariance,
    "looks": try_looks,
    "offsets": try_offsets,
    "injected": try_injected,
    "chips": try_chips,
    "ignorance": try_ignorance,
}


def reference(bench: Bench) -> None:
    """Tell of the reference, `fused` on the raster: three sub-bands, metal, twice the contrast."""
    learnt = bench.by_site(lambda trained: trained.classes(LOW))

    def value(lane: Lane) -> np.ndarray:
        clutter, directions = learnt[lane.site]
        found = ratios_of(clutter.white(lane), lane.metre, directions["metal"])
        return lane.mean(found + 2 * level(lane))

    bench.tell("**`fused`, on the raster**", value)


def main(arguments: list[str] | None = None) -> None:
    """Try the variants, and print their tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("ground", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--tier", action="append")
    parser.add_argument("--only", action="append", choices=EXPERIMENTS)
    parser.add_argument("--without-further", action="store_true")
    given = parser.parse_args(arguments)
    given.out.mkdir(parents=True, exist_ok=True)
    signatures = {name: simulate_signatures(name, given.out) for name in BODIES}
    for tier in given.tier or load_ground().table.tiers:
        lanes = load_lanes(given.ground, given.out, tier, not given.without_further)
        bench = Bench(tier, lanes, signatures)
        reference(bench)
        for name in given.only or EXPERIMENTS:
            EXPERIMENTS[name](bench)


if __name__ == "__main__":
    main()
