"""The small lane of scatterers, and what passes find on it however its scans are divided."""

from functools import cache

from flgpr.method.imaged_run import ImagedRun
from flgpr.method.passes.background import SelfSignaturePass, SmoothGain
from flgpr.method.passes.run_view import Maxima, RunView
from flgpr.method.passes.traversal import ImagedScan
from flgpr.recipe.schema import parse_recipe
from small_lane import LANE, small_recipe, small_run

SCANS = 13
DIVISIONS = ([range(0, 13)], [range(0, 5), range(5, 13)], [range(k, k + 1) for k in range(13)])
"""Blocks of all scans: one, two of different lengths, and one for every scan."""


@cache
def recorded():
    return small_run(SCANS)


def setup(text=None, **options):
    """Make the setup of the small lane, without what explains alarms and without results."""
    recipe = parse_recipe(text or small_recipe())
    return ImagedRun(recorded(), recipe, LANE, explains=False, **options)


def in_blocks(kind, lane, blocks, exact=True):
    """Return the result of a pass whose blocks are added apart and merged in their order."""
    total = kind(lane, None)
    for block in blocks:
        part = kind(lane, block)
        for index in block:
            part.add(ImagedScan(lane, index))
        total.merge(part.state(exact))
    return total.result()


@cache
def results_of_lane():
    """Return the results of the passes up to the alarms, of scans in one block."""
    lane = setup()
    for kind in (SelfSignaturePass, SmoothGain, RunView):
        lane.results[kind.name] = in_blocks(kind, lane, DIVISIONS[0])
    lane.results["alarms"] = Maxima(lane, None).result()
    return lane.results


def with_results(**options):
    """Make the setup of the small lane with the results of the passes up to the alarms."""
    return setup(results=dict(results_of_lane()), **options)


def same_bits(first, second):
    """Return whether two results hold the same arrays, bit by bit."""
    if first.keys() != second.keys():
        return False
    return all(first[name].tobytes() == second[name].tobytes() for name in first)
