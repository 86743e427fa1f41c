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
        # Rules 1 and 2: of the alarms near the same target one is a detection, the others are ignored.
        near = [alarm for alarm in declared if within(alarm, targets[number], halo)]
        if to_the_letter:
            # Rule 5: alarms near other known targets are not considered as either detections or false alarms.
            others = [target for k, target in enumerate(targets) if k not in scored]
            near = [alarm for alarm in near if not any(within(alarm, other, halo) for other in others)]
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
    return [(t, *wang_counts(alarms, targets, lane, halo, t, scored, to_the_letter)) for t in thresholds]


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
        total, reach = 0.0, -math.inf
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
    middle, half = (low + high) / 2, (high - low) / 2
    return quad(lambda t: function(middle - half * math.cos(t)) * half * math.sin(t), 0, math.pi, epsabs=1e-11)[0]
