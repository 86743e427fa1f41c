"""Experiments that combine sub-bands, classes of bodies, looks and covariances in another way."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from scipy.special import logsumexp

from fused_maps.lanes import BANDS, FOUR, LOW, METRES, NAVIGATION, Lane
from fused_maps.learnt import RATIOS, Clutter, Trained, ratios_of, sums_of, with_neighbours
from fused_maps.scores import Bench, level
from fused_maps.signatures import CLASSES, phases_of


def names_of(bands: Sequence[int]) -> str:
    """Return the limits of a range of sub-bands in words."""
    limits = list(BANDS.values())
    return f"{limits[bands[0]][0] / 1e9:g} to {limits[bands[-1]][1] / 1e9:g} GHz"


def try_bands(bench: Bench) -> None:
    """Try ranges of sub-bands, and signatures of other bodies as classes of their own."""
    bench.tell("contrast of HH and VV alone", lambda lane: lane.mean(level(lane)))
    for bands in (FOUR, (0, 1, 2, 3, 4), tuple(range(7)), LOW):
        values: dict[int, dict[str, np.ndarray]] = {}
        learnt = bench.by_site(lambda trained, bands=bands: trained.classes(bands))
        for lane in bench.lanes:
            clutter, directions = learnt[lane.site]
            white = clutter.white(lane)
            values[id(lane)] = {
                name: ratios_of(white, lane.metre, found) for name, found in directions.items()
            }

        def pooled(lane: Lane, names: Sequence[str], values=values) -> np.ndarray:
            some = [values[id(lane)][name] for name in names]
            return logsumexp(some, axis=0) - math.log(len(some))

        title = names_of(bands)
        if bands != LOW:
            bench.tell(
                title, lambda lane, v=pooled: lane.mean(v(lane, ["metal"]) + 2 * level(lane))
            )
        else:
            bench.tell(
                f"{title}, without contrast", lambda lane, v=pooled: lane.mean(v(lane, ["metal"]))
            )
            for names in (["fuzed"], ["air"], ["ap"], list(CLASSES)):
                bench.tell(
                    f"{title}, signatures of {' or '.join(names)}",
                    lambda lane, v=pooled, n=names: lane.mean(v(lane, n) + 2 * level(lane)),
                )
        if bands == FOUR:
            bench.tell(
                f"{title}, contrast of all four",
                lambda lane, v=pooled: lane.mean(v(lane, ["metal"]) + 2 * level(lane, FOUR)),
            )


def try_weights(bench: Bench) -> None:
    """Weight looks otherwise by their distance, or leave the far ones out."""
    learnt = bench.by_site(lambda trained: trained.classes(LOW))
    values = {}
    for lane in bench.lanes:
        clutter, directions = learnt[lane.site]
        found = ratios_of(clutter.white(lane), lane.metre, directions["metal"])
        values[id(lane)] = found + 2 * level(lane)
    for title, power, farthest in (
        ("looks weighted by the inverse of their distance", 1, 16.0),
        ("looks weighted by its inverse cube", 3, 16.0),
        ("looks up to 12 m ahead", 2, 12.0),
    ):

        def value(lane: Lane, power=power, farthest=farthest) -> np.ndarray:
            distance = np.linalg.norm(lane.xy.astype(float), axis=1)
            weight = distance**-power * (lane.xy[:, 1] <= farthest)
            return lane.mean(values[id(lane)], weight)

        bench.tell(title, value)


def try_covariance(bench: Bench) -> None:
    """Mix the covariance of the lane itself into that of the training lanes."""
    for bands in (LOW, FOUR):
        learnt = bench.by_site(lambda trained, bands=bands: trained.classes(bands))
        for share in (0.3, 0.6, 0.9):

            def value(lane: Lane, bands=bands, learnt=learnt, share=share) -> np.ndarray:
                prior, directions = learnt[lane.site]
                first = ratios_of(prior.white(lane), lane.metre, directions["metal"])
                # A tenth of the places, those most like a mine, is left out.
                seen = lane.mean(first + 2 * level(lane)).ravel()
                ordinary = (seen <= np.nanquantile(seen, 0.9))[lane.place]
                own = with_neighbours(*sums_of(lane.chips(bands)[ordinary], lane.metre[ordinary]))
                own *= prior.values / np.trace(own, axis1=1, axis2=2).real[:, None, None]
                mixed = Clutter.of(bands, (1 - share) * prior.covariance + share * own)
                moved = carried(directions["metal"], prior, mixed)
                return lane.mean(ratios_of(mixed.white(lane), lane.metre, moved) + 2 * level(lane))

            bench.tell(f"{names_of(bands)}, {share:g} of the lane's own covariance", value)


def carried(directions: list, prior: Clutter, clutter: Clutter) -> list:
    """Return directions in other clutter: those of the same mean signature."""
    found = []
    for metre, (vectors, share) in enumerate(directions):
        back = np.linalg.inv(prior.whitener[metre].astype(complex))
        strong = clutter.whitener[metre] @ (back @ (vectors.conj().T * np.sqrt(share)))
        left, strength, _ = np.linalg.svd(strong, full_matrices=False)
        new_share = strength**2 * (share.sum() / (strength**2).sum())
        found.append((left.T.conj().astype(np.complex64), new_share))
    return found


def try_looks(bench: Bench) -> None:
    """Take the looks at a place as one vector, with the phases between them and without.

    Every look is over its own power. S is that of all signatures over all looks; the errors of
    navigation move every look by itself.
    """
    everything = [body for bodies in CLASSES.values() for body in bodies]
    for bodies, title in ((CLASSES["metal"], "metal"), (everything, "all bodies")):
        for coherent in (False, True):
            learnt = bench.by_site(lambda trained, b=bodies, c=coherent: _stacked(trained, b, c))
            words = "with phases" if coherent else "without phases"
            bench.tell(
                f"looks jointly, {words}, signatures of {title}",
                lambda lane, known=learnt, c=coherent: (
                    _joint(lane, *known[lane.site], c) + 2 * lane.mean(level(lane))
                ),
            )


def _stacked(
    trained: Trained, bodies: Sequence[str], coherent: bool
) -> tuple[Clutter, np.ndarray, np.ndarray]:
    """Return the clutter, 24 directions by metre, and bodies (body, metre, direction) in them."""
    clutter = trained.clutter(LOW)
    rng = np.random.default_rng(51)
    chips = []
    for body in bodies:
        of_body = trained.signatures[body]
        for lane in trained.lanes[::2]:
            some = of_body.by_metre(of_body.in_units(lane))[:, :, :, list(LOW)]
            for _ in range(3 if coherent else 1):
                error = rng.normal(0, NAVIGATION, some.shape[:2])
                chips.append((some * phases_of(error, LOW)).reshape(len(some), METRES, -1))
    chip = np.concatenate(chips).astype(np.complex64)
    white = np.stack([chip[:, m] @ clutter.whitener[m].T for m in range(METRES)], axis=1)
    white /= np.sqrt((np.abs(white) ** 2).sum(axis=2).mean(axis=1))[:, None, None]
    vectors = []
    for metre in range(METRES):
        of_metre = white[:, metre]
        _, _, right = np.linalg.svd(
            of_metre / np.linalg.norm(of_metre, axis=1)[:, None], full_matrices=False
        )
        vectors.append(right[:24].conj())
    parts = np.stack([white[:, m] @ vectors[m].T for m in range(METRES)], axis=1)
    return clutter, np.array(vectors), parts


def _joint(lane: Lane, clutter: Clutter, vectors, parts, coherent: bool) -> np.ndarray:
    """Return the log-likelihood ratio (y, x) of all looks at each place over their number."""
    white = clutter.white(lane)
    power = (np.abs(white) ** 2).sum(axis=1)
    part = np.empty((len(white), vectors.shape[1]), np.complex64)
    for metre in range(METRES):
        at = lane.metre == metre
        part[at] = white[at] @ vectors[metre].T
    part = part / np.sqrt(power / clutter.values)[:, None]
    value = np.full(lane.places, np.nan)
    for metres, (places, looks) in _alike(lane).items():
        count, rank = len(metres), vectors.shape[1]
        stacked = parts[:, list(metres)]
        body = np.zeros((count * rank, count * rank), complex)
        if coherent:
            joined = stacked.reshape(len(stacked), -1)
            body = joined.T @ joined.conj() / len(joined)
        else:
            for look in range(count):
                block = slice(look * rank, (look + 1) * rank)
                one = stacked[:, look]
                body[block, block] = one.T @ one.conj() / len(one)
        strength, directions = np.linalg.eigh(body)
        strength = np.maximum(strength[::-1][:60], 0)
        directions = directions[:, ::-1][:, :60].astype(np.complex64)
        shown = part[looks].reshape(len(places), -1) @ directions.conj()
        share = np.abs(shown) ** 2 / (count * clutter.values)
        gain = np.array(RATIOS)[:, None] * strength
        rest = np.maximum(1 - share @ (gain / (1 + gain)).T, 1e-6)
        by_power = -clutter.values * count * np.log(rest) - np.log1p(gain).sum(axis=1)
        value[places] = (logsumexp(by_power, axis=1) - math.log(len(RATIOS))) / count
    return value.reshape(lane.rows, lane.columns)


def _alike(lane: Lane) -> dict[tuple[int, ...], tuple[np.ndarray, np.ndarray]]:
    """Return places and their looks (place, look) by the metres at which the looks are."""
    if not lane.groups:
        order = np.lexsort((lane.scan, lane.place))
        first = np.flatnonzero(np.diff(lane.place[order], prepend=-1))
        found: dict[tuple[int, ...], list] = {}
        for looks in np.split(order, first[1:]):
            key = tuple(lane.metre[looks].tolist())
            found.setdefault(key, []).append((lane.place[looks[0]], looks))
        for key, pairs in found.items():
            places, looks = zip(*pairs, strict=True)
            lane.groups[key] = (np.array(places), np.array(looks))
    return lane.groups


def try_offsets(bench: Bench) -> None:
    """Take narrow subspaces for places beside the raster, the same for all looks at a place."""
    moves = (-0.08, -0.04, 0.0, 0.04, 0.08)
    for rank in (6, 12):

        def learn(trained: Trained, rank=rank) -> tuple[Clutter, list[list]]:
            clutter = trained.clutter(LOW)
            metal = CLASSES["metal"]
            return clutter, [trained.directions(clutter, metal, rank, ahead) for ahead in moves]

        learnt = bench.by_site(learn)

        def value(lane: Lane, learnt=learnt) -> np.ndarray:
            clutter, by_move = learnt[lane.site]
            white = clutter.white(lane)
            maps = [lane.mean(ratios_of(white, lane.metre, found)) for found in by_move]
            looks = np.bincount(lane.place, minlength=lane.places)
            looks = np.maximum(looks.reshape(lane.rows, lane.columns), 1)
            together = logsumexp(np.array(maps) * looks, axis=0) / looks
            return together + 2 * lane.mean(level(lane))

        bench.tell(f"metal at one of five offsets ahead, {rank} directions each", value)
