"""Slow, obvious twins of the scoring routines, written from the papers' sentences."""

import itertools
import math

import numpy as np
from scipy.integrate import quad


def within(alarm, target, halo):
    return float(np.hypot(alarm["x"] - target["x"], alarm["y"] - target["y"])) <= halo


def in_lane(alarm, lane):
    return lane.x_min <= alarm["x"] <= lane.x_max and lane.y_min <= alarm["y"] <= lane.y_max


def wang_counts(alarms, targets, lane, halo, threshold, scored=None, to_the_letter=False):
    """Wang et al. 2007, Sec. II-F, rules 1 to 5, for one threshold: numbers of detected targets and of false alarms."""
    scored = list(range(len(targets))) if scored is None else scored
    declared = [alarm for alarm in alarms if alarm["confidence"] >= threshold]
    detected = 0
    for number in scored:
        # Rules 1 and 2: of the alarms near the same target one is a detection, the others are
        # ignored.
        near = [alarm for alarm in declared if within(alarm, targets[number], halo)]
        if to_the_letter:
            # Rule 5: alarms near other known targets are not considered as either detections or
            # false alarms.
            others = [target for k, target in enumerate(targets) if k not in scored]
            near = [
                alarm for alarm in near if not any(within(alarm, other, halo) for other in others)
            ]
        detected += bool(near)
    n_false = 0
    for alarm in declared:
        near_any = any(within(alarm, target, halo) for target in targets)
        if not near_any and in_lane(alarm, lane):  # rule 3
            n_false += 1
        # Rule 4: neither near a target nor in the lane is neither.
    return detected, n_false


def wang_roc(alarms, targets, lane, halo, scored=None, to_the_letter=False):
    """All thresholds: +inf and every distinct confidence, falling."""
    thresholds = [math.inf, *sorted({alarm["confidence"] for alarm in alarms}, reverse=True)]
    return [
        (t, *wang_counts(alarms, targets, lane, halo, t, scored, to_the_letter)) for t in thresholds
    ]


def wang_area(targets, lane, halo):
    """Wang et al. 2007, rule 6."""
    return lane.area - len(targets) * math.pi * halo**2


def chord_area(centres, radius, lane):
    """Area of discs within a lane: the length of their chords, overlaps once, integrated piece by piece over y."""

    def length(y):
        spans = []
        for cx, cy in centres:
            if abs(y - cy) < radius:
                half = math.sqrt(radius**2 - (y - cy) ** 2)
                spans.append((max(cx - half, lane.x_min), min(cx + half, lane.x_max)))
        total = 0.0
        reach = -math.inf
        for low, high in sorted(span for span in spans if span[1] > span[0]):
            total += max(0.0, high - max(low, reach))
            reach = max(reach, high)
        return total

    breaks = {lane.y_min, lane.y_max}
    for i, (cx, cy) in enumerate(centres):
        breaks |= {cy - radius, cy + radius}
        for border in (lane.x_min, lane.x_max):
            if abs(border - cx) < radius:
                half = math.sqrt(radius**2 - (border - cx) ** 2)
                breaks |= {cy - half, cy + half}
        for ox, oy in centres[:i]:
            gap = math.hypot(ox - cx, oy - cy)
            if 0 < gap < 2 * radius:
                rise = math.sqrt(radius**2 - gap**2 / 4) * (ox - cx) / gap
                breaks |= {(cy + oy) / 2 - rise, (cy + oy) / 2 + rise}
    knots = sorted(y for y in breaks if lane.y_min <= y <= lane.y_max)
    return sum(_smooth(length, low, high) for low, high in itertools.pairwise(knots) if high > low)


def _smooth(function, low, high):
    """Integrate with y = middle - half·cos(t), which takes the square roots at the ends out."""
    middle = (low + high) / 2
    half = (high - low) / 2
    return quad(
        lambda t: function(middle - half * math.cos(t)) * half * math.sin(t),
        0,
        math.pi,
        epsabs=1e-11,
    )[0]


def random_lists(seed, lists=10):
    """Alarm lists and targets with ties, duplicates, empty lists, shared halos and points on every border."""
    rng = np.random.default_rng(seed)
    for _ in range(lists):
        step = rng.choice(
            [0.25, 0.5, 0.0]
        )  # on a lattice distances equal the halo and borders exactly
        drawn = []
        for count in (rng.integers(0, 16), rng.integers(1, 6)):
            points = rng.uniform([-1, -1], [5, 11], size=(count, 2))
            drawn.append(np.round(points / step) * step if step else points)
        if len(drawn[0]) > 3:
            drawn[0][0] = drawn[0][1]
            drawn[0][2] = drawn[1][0]
        scores = rng.choice(
            [rng.normal(size=len(drawn[0])), rng.integers(0, 4, len(drawn[0])).astype(float)]
        )
        alarms = [
            {"x": float(x), "y": float(y), "confidence": float(c)}
            for (x, y), c in zip(drawn[0], scores, strict=True)
        ]
        kinds = rng.choice(["metal", "plastic"], len(drawn[1]))
        targets = [
            {"x": float(x), "y": float(y), "kind": str(k)}
            for (x, y), k in zip(drawn[1], kinds, strict=True)
        ]
        yield alarms, targets, float(rng.choice([0.5, 1.0, 1.25]))


def best_share(rows, targets, area, far_max):
    """PD_mean (Wang et al. 2007, Sec. II-F): the integral of the best Pd at each allowed FAR, strip by strip."""
    points = [(detected / targets, false / area) for _, detected, false in rows]
    edges = sorted({0.0, far_max, *(far for _, far in points if far < far_max)})
    strips = itertools.pairwise(edges)
    return sum((b - a) * max(pd for pd, far in points if far <= a) for a, b in strips) / far_max


def box_curve(image, x, y, targets, lane, box):
    """Cosgrove et al. 2004, Sec. IV-B: peaks in boxes at mines (H1) and offset from them (H0), pixel by pixel."""

    def peaks(centres):
        found = []
        for look in image:
            for cx, cy in centres:
                inside = [
                    look[row][column]
                    for row in range(len(y))
                    for column in range(len(x))
                    if cx - box / 2 <= x[column] < cx + box / 2
                    and cy - box / 2 <= y[row] < cy + box / 2
                ]
                inside = [value for value in inside if not math.isnan(value)]
                if inside:
                    found.append(max(inside))
        return found

    centres = []
    for row in range(int((lane.y_max - lane.y_min) / box)):
        for column in range(int((lane.x_max - lane.x_min) / box)):
            cx = lane.x_min + box * (column + 0.5)
            cy = lane.y_min + box * (row + 0.5)
            if all(abs(cx - tx) >= box or abs(cy - ty) >= box for tx, ty in targets):
                centres.append((cx, cy))
    at = peaks(targets)
    off = peaks(centres)
    rows = [(math.inf, 0.0, 0.0)]
    for threshold in sorted({*at, *off}, reverse=True):
        pd = sum(value >= threshold for value in at) / len(at)
        rows.append((threshold, pd, sum(value >= threshold for value in off) / len(off) / box**2))
    return rows


def example_curve(scores, labels, area):
    """Count flsar2004's way (par. 45): a clutter example called a mine is a false alarm, per square metre searched."""
    rows = [(math.inf, 0.0, 0.0)]
    for threshold in sorted(set(scores), reverse=True):
        called = [label for score, label in zip(scores, labels, strict=True) if score >= threshold]
        rows.append((threshold, sum(called) / sum(labels), (len(called) - sum(called)) / area))
    return rows


def replicate_pd(target, times, false, false_times, area, far):
    """Pd at an allowed FAR of a bootstrap replicate: every target and false alarm written out as often as drawn."""
    targets = [score for score, count in zip(target, times, strict=True) for _ in range(int(count))]
    falses = [
        score for score, count in zip(false, false_times, strict=True) for _ in range(int(count))
    ]
    best = 0.0
    for threshold in {*target, *false} - {-math.inf}:
        if sum(score >= threshold for score in falses) / area <= far:
            best = max(best, sum(score >= threshold for score in targets) / len(targets))
    return best


def sign_flip_p(differences):
    """Two-sided p over all ways to flip the signs."""
    seen = abs(sum(differences))
    sums = [
        abs(sum(sign * value for sign, value in zip(signs, differences, strict=True)))
        for signs in itertools.product((1, -1), repeat=len(differences))
    ]
    return sum(total >= seen for total in sums) / len(sums)


def fewest_mines(pd, misses, confidence):
    """Smallest n for which a detector of exactly this Pd misses so few with probability 1 - confidence at most."""
    mines = misses + 1
    while True:
        chance = sum(
            math.comb(mines, k) * (1 - pd) ** k * pd ** (mines - k) for k in range(misses + 1)
        )
        if chance <= 1 - confidence:
            return mines
        mines += 1


def seen_in_time(sightings, distance):
    """Alarms known while still so far away: every alarm with its best sighting from there."""
    best = {}
    for row in sightings:
        if (
            row["ahead"] >= distance
            and row["confidence"]
            > best.get(row["alarm_id"], {"confidence": -math.inf})["confidence"]
        ):
            best[row["alarm_id"]] = row
    return list(best.values())


def moved_best(alarms, targets, lane, halo, shift):
    """Best alarm in each target's halo once all targets went so far along a lane closed to a ring; None: not clear."""
    length = lane.y_max - lane.y_min

    def apart(x, y, point):
        return min(
            math.hypot(x - point["x"], y - point["y"] + turn * length) for turn in range(-3, 4)
        )

    free = [alarm for alarm in alarms if not any(within(alarm, target, halo) for target in targets)]
    free = [alarm for alarm in free if lane.y_min <= alarm["y"] <= lane.y_max]
    best = []
    for target in targets:
        x, y = target["x"], target["y"] + shift
        if any(apart(x, y, other) < 2 * halo for other in targets):
            best.append(None)
        else:
            best.append(
                max((a["confidence"] for a in free if apart(x, y, a) <= halo), default=-math.inf)
            )
    return best


def frame_counts(alarms, poses, truth, area, halo, threshold=-math.inf):
    """Fuse et al. 2018, Sec. 4, frame by frame: whether each look at a target has an alarm, and all false alarms.

    A look is a target in a frame's detection area. An alarm near a target that is in none is not counted.
    """
    looks = []
    n_false = 0
    for frame, pose in poses.items():
        # clockwise from +y
        x = pose[0]
        y = pose[1]
        heading = pose[3]
        declared = alarms[(alarms["frame"] == frame) & (alarms["confidence"] >= threshold)]
        seen = [(row.across, row.ahead) for row in declared.itertuples()]
        targets = []
        for target in truth.itertuples():
            east = target.x - x
            north = target.y - y
            across = east * math.cos(heading) - north * math.sin(heading)
            ahead = east * math.sin(heading) + north * math.cos(heading)
            targets.append((across, ahead))
            if area.x_min <= across <= area.x_max and area.y_min <= ahead <= area.y_max:
                looks.append(any(math.dist(one, (across, ahead)) <= halo for one in seen))
        n_false += sum(all(math.dist(one, target) > halo for target in targets) for one in seen)
    return looks, n_false
